"""What a page of the documentation holds: sections, blocks, commands, inline code, rows of tables."""

import re
import shlex
from pathlib import Path

FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)
INDENTED = re.compile(r"(?<=\n\n)(?: {4}.*\n)+")


def load(repository: Path) -> dict[str, str]:
    """The text of each page by its path."""
    paths = [repository / "README.md", *repository.glob("docs/*.md"), *repository.glob("msg_schemas/*.md")]
    return {str(path.relative_to(repository)): path.read_text(encoding="utf-8") for path in sorted(paths)}


def headings(text: str) -> list[re.Match]:
    """The headings; comments in code are none."""
    return list(HEADING.finditer(FENCE.sub(lambda fence: re.sub("(?m)^#", " ", fence[0]), text)))


def section(text: str, heading: str) -> str:
    """The text under the first heading that matches this regular expression, until the next heading."""
    found = headings(text)
    for this, following in zip(found, [*found[1:], None]):
        if re.search(heading, this[1]):
            return text[this.end():following.start() if following else None]
    raise LookupError(f"no heading {heading!r} among {[one[1] for one in found]}")


def fenced(text: str, language: str) -> list[str]:
    """The fenced blocks in this language."""
    return [block[2] for block in FENCE.finditer(text) if block[1] == language]


def indented(text: str) -> list[str]:
    """The blocks that are indented by four spaces, without the indent; a blank line ends one."""
    return [re.sub("(?m)^ {4}", "", block).strip("\n") for block in INDENTED.findall(FENCE.sub("", text))]


def command_lines(text: str) -> list[list[str]]:
    """The words of each shell command in the page's blocks, without comments."""
    lines = "\n".join(indented(text)).replace("\\\n", " ").splitlines()
    return [command for line in lines for command in _commands(line)]


def _commands(line: str) -> list[list[str]]:
    """The commands of a line, which && and ; join; nothing of a line that a shell could not read."""
    try:
        lexer = shlex.shlex(line, posix=True, punctuation_chars=";&|")
        lexer.whitespace_split = True
        words = list(lexer)
    except ValueError:
        return []
    commands: list[list[str]] = [[]]
    for word in words:
        if set(word) <= set(";&|"):
            commands.append([])
        else:
            commands[-1].append(word)
    return [command for command in commands if command]


def inline(text: str) -> list[str]:
    """What stands in single backticks, also across a line's end."""
    return [re.sub(r"\s+", " ", code).strip() for code in re.findall(r"(?<!`)`([^`]+)`(?!`)", FENCE.sub("", text))]


def rows(text: str) -> list[list[str]]:
    """The cells of each row of the tables."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]
