"""Parse the pages of the documentation: sections, code blocks, commands and inline code."""

import re
import shlex
from contextlib import suppress
from pathlib import Path

from markdown_it import MarkdownIt

ROOT = Path(__file__).resolve().parents[2]
PATHS = {*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")} - {ROOT / "docs/RESULTS.md"}      # whose revisions are older
PAGES = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in sorted(PATHS)}
MARKDOWN = MarkdownIt().enable("table")


def section(text: str, heading: str) -> str:
    """The text under the heading that begins so, until the next heading."""
    return re.search(rf"(?ms)^#+ {re.escape(heading)}.*?$(.*?)(?=^#+ |\Z)", text)[1]


def fenced(text: str, language: str) -> list[str]:
    """The fenced blocks in this language."""
    return [token.content for token in MARKDOWN.parse(text) if token.type == "fence" and token.info == language]


def indented(text: str) -> list[str]:
    """The blocks that are indented by four spaces, without the indent; a blank line ends one."""
    blocks = [token.content for token in MARKDOWN.parse(text) if token.type == "code_block"]
    return [part.strip("\n") for block in blocks for part in block.split("\n\n")]


def command_lines(text: str) -> list[list[str]]:
    """The words of each shell command in the page's blocks, without comments; skips lines that no shell can parse."""
    commands: list[list[str]] = []
    for line in "\n".join(indented(text)).replace("\\\n", " ").splitlines():
        for command in re.split(r"&&|;|\|", re.sub(r"(^|\s)#.*", "", line)):
            with suppress(ValueError):
                commands.append(shlex.split(command))
    return [command for command in commands if command]


def inline(text: str) -> list[str]:
    """All inline code, also across the end of a line."""
    parts = [part for token in MARKDOWN.parse(text) for part in token.children or ()]
    return [part.content for part in parts if part.type == "code_inline"]
