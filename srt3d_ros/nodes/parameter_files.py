"""What of a parameter file is for none of the nodes that were given it: ROS 2 passes over it in silence."""

import difflib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import yaml

from srt3d_ros.node_names import NODES

ALIKE = 0.75            # names between which somebody may have mistyped one
SECTIONS_TOLD = 5


def given_files(arguments: Sequence[str]) -> list[Path]:
    """The parameter files among a command line's arguments."""
    return [Path(value) for flag, value in zip(arguments, arguments[1:]) if flag == "--params-file"]


def passed_over(path: Path, nodes: Sequence[str]) -> list[str]:
    """What is to be said about a file that rcl could read, in one line each; mostly nothing.

    A section for another node is as it should be: a robot has one file for many. Told is a section that nearly has the
    name of a node without one, and a file that knows none of our nodes.

    Args:
        nodes: the full names of those that were given the file, such as "/left/sketcher".
    """
    if not path.is_file():      # a pipe, say, can be read only once, and rcl has
        return []
    try:
        sections = list(_sections(yaml.safe_load(path.read_text())))
    except (OSError, ValueError, RecursionError, yaml.YAMLError):       # rcl's parser takes a little more than this one
        return []
    patterns = {section: _pattern(section) for section in sections}
    without = [node for node in nodes if not any(pattern.fullmatch(node) for pattern in patterns.values())]
    others = [section for section, pattern in patterns.items() if not any(map(pattern.fullmatch, nodes))]
    mistyped = [(section, node) for node in without for section in others if _alike(section, node)]
    if mistyped:
        return [f"{path}: parameters of {section} are for no node here: did you mean {node}?"
                for section, node in mistyped]
    if len(without) < len(nodes) or any(_last(section) in NODES for section in sections):
        return []
    told = ", ".join(sections[:SECTIONS_TOLD]) + ", …" * (len(sections) > SECTIONS_TOLD)
    return [f"{path}: no parameters for {' or '.join(nodes)}: expected a section of this name, found {told or 'none'}"]


def _sections(tree, above: str = "") -> Iterator[str]:
    """The names of nodes, which may be patterns, with namespaces that are written one in another."""
    for key, value in tree.items() if isinstance(tree, dict) else ():
        name = f"{above}/{str(key).strip('/')}"
        if isinstance(value, dict) and key != "ros__parameters":
            if "ros__parameters" in value:
                yield name
            yield from _sections(value, name)


def _pattern(section: str) -> re.Pattern:
    """As rclpy matches names: * is one part of a name, ** any number of them."""
    forms = {"**": r"(/\w+)*", "*": r"/\w+"}
    return re.compile("".join(forms.get(part, f"/{re.escape(part)}") for part in section.strip("/").split("/")))


def _alike(section: str, node: str) -> bool:
    return difflib.SequenceMatcher(None, _last(section), _last(node)).ratio() >= ALIKE


def _last(name: str) -> str:
    return name.rpartition("/")[2]
