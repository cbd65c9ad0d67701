"""What a page of the documentation holds, found by heading and kind rather than by line: blocks, commands, tables."""

import re
import shlex
from collections.abc import Iterator

FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)
INDENT = "    "


def section(text: str, heading: str) -> str:
    """The text under the first heading that matches this regular expression, until the next heading."""
    plain = FENCE.sub(lambda fence: re.sub(r"(?m)^#", " ", fence[0]), text)     # comments in code are no headings
    found = list(HEADING.finditer(plain))
    for this, following in zip(found, [*found[1:], None]):
        if re.search(heading, this[1]):
            return text[this.end():following.start() if following else None]
    raise LookupError(f"no heading {heading!r} among {[one[1] for one in found]}")


def fenced(text: str, language: str) -> str:
    """The first fenced block in this language."""
    for block in FENCE.finditer(text):
        if block[1] == language:
            return block[2]
    raise LookupError(f"no ```{language} block in: {text[:80]!r}")


def indented(text: str) -> list[str]:
    """The blocks that are indented by four spaces, without the indent; lines of lists and tables are none of them."""
    blocks, current, after_blank = [], [], True
    for line in [*FENCE.sub("", text).splitlines(), ""]:
        if line.startswith(INDENT) and (current or after_blank):
            current.append(line.removeprefix(INDENT))
        elif current:
            blocks.append("\n".join(current))
            current = []
        after_blank = not line.strip()
    return blocks


def command_lines(text: str) -> list[list[str]]:
    """The words of each shell command in the page's blocks; a comment and a prompt are no part of it."""
    shell = [*indented(text), *(block[2] for block in FENCE.finditer(text) if block[1] in ("bash", "sh", "console"))]
    lines = "\n".join(shell).replace("\\\n", " ").splitlines()
    return [words for line in lines for words in _commands(line.strip().removeprefix("$ "))]


def inline(text: str) -> list[str]:
    """What stands in single backticks, also across a line's end."""
    return [re.sub(r"\s+", " ", code).strip() for code in re.findall(r"(?<!`)`([^`]+)`(?!`)", FENCE.sub("", text))]


def rows(text: str) -> list[list[str]]:
    """The cells of each row of the tables, without heads and rules."""
    lines = [line.strip() for line in text.splitlines()]
    body = [line for k, line in enumerate(lines) if line.startswith("|") and not _is_rule(line)
            and not (k + 1 < len(lines) and _is_rule(lines[k + 1]))]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in body]


def _is_rule(line: str) -> bool:
    return bool(re.fullmatch(r"\|[\s:|-]+\|", line))


def _commands(line: str) -> Iterator[list[str]]:
    """The commands of a line, which && and ; join; nothing of a line that a shell could not read (figures, text)."""
    try:
        lexer = shlex.shlex(line, posix=True, punctuation_chars=";&|")
        lexer.whitespace_split = True
        words = list(lexer)
    except ValueError:
        return
    command: list[str] = []
    for word in [*words, ";"]:
        if set(word) <= set(";&|"):
            if command:
                yield command
            command = []
        else:
            command.append(word)
