"""What a page of the documentation holds: sections, blocks, commands, inline code."""

import re
import shlex
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PATHS = {ROOT / "README.md", *ROOT.glob("docs/*.md")} - {ROOT / "docs/RESULTS.md"}      # whose revisions are older
PAGES = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in sorted(PATHS)}
FENCE = re.compile(r"^```([\w{}-]*)[^\n]*\n(.*?)^```$", re.DOTALL | re.MULTILINE)
INDENTED = re.compile(r"(?<=\n\n)(?: {4}.*\n)+")


def section(text: str, heading: str) -> str:
    """The text under the heading that begins so, until the next heading."""
    return re.search(rf"(?ms)^#+ {re.escape(heading)}.*?$(.*?)(?=^#+ |\Z)", text)[1]


def fenced(text: str, language: str) -> list[str]:
    """The fenced blocks in this language."""
    return [block[2] for block in FENCE.finditer(text) if block[1] == language]


def indented(text: str) -> list[str]:
    """The blocks that are indented by four spaces, without the indent; a blank line ends one."""
    return [re.sub("(?m)^ {4}", "", block).strip("\n") for block in INDENTED.findall(FENCE.sub("", text))]


def command_lines(text: str) -> list[list[str]]:
    """The words of each shell command in the page's blocks, without comments."""
    commands: list[list[str]] = []
    for line in "\n".join(indented(text)).replace("\\\n", " ").splitlines():
        lexer = shlex.shlex(line, posix=True, punctuation_chars=";&|")
        lexer.whitespace_split = True
        commands.append([])
        try:
            for word in lexer:
                if set(word) <= set(";&|"):
                    commands.append([])
                else:
                    commands[-1].append(word)
        except ValueError:          # no shell could read this line: output, or a table
            commands.pop()
    return [command for command in commands if command]


def inline(text: str) -> list[str]:
    """What stands in single backticks, also across a line's end."""
    return [re.sub(r"\s+", " ", code).strip() for code in re.findall(r"(?<!`)`([^`]+)`(?!`)", FENCE.sub("", text))]
