"""What the commands in the documentation name exists: sub-commands, options, nodes, parameters, configs, extras."""

import importlib.util
import re
import runpy

import pytest

from srt3d_ros import shared_files
from srt3d_ros.cli import main
from srt3d_ros.node_names import NODES
from srt3d_ros.nodes.specs import SPECS
from tests.docs import pages

PROGRAM = re.compile(r"(^|/bin/)srt3d$")        # also after ExecStart=, or in a container
PLACEHOLDER = re.compile(r"…|\[")               # an inline command that is cut short, or says what it may have
TOPICS = {topic.name for spec in SPECS.values() for topic in (*spec.inputs, *spec.outputs)}
OF_EVERY_NODE = ("use_sim_time", "qos_overrides.")


@pytest.fixture(scope="module")
def texts(repository) -> dict[str, str]:
    """The text of each page by its name."""
    found = [repository / "README.md", *repository.glob("docs/**/*.md"), *repository.glob("msg_schemas/*.md")]
    return {str(path.relative_to(repository)): path.read_text(encoding="utf-8") for path in sorted(found)}


def _srt3d(text: str):
    """The arguments of each `srt3d …` in the page's blocks."""
    for words in pages.command_lines(text):
        for k, word in enumerate(words):
            if PROGRAM.search(word):
                yield words[k + 1:]
                break


def test_the_commands_of_these_pages_are_found(texts):
    assert {"README.md", "docs/quickstart-driver.md", "docs/bags.md", "docs/review.md", "docs/calibration.md",
            "docs/evaluation.md"} <= {page for page, text in texts.items() if list(_srt3d(text))}


def test_every_command_line_parses(texts, capsys):
    wrong = []
    for page, text in texts.items():
        for words in _srt3d(text):
            try:
                args = main.parser((words[0],) if words[0] in main.COMMANDS else main.COMMANDS).parse_args(words)
                wrong += [f"{page}: srt3d {' '.join(words)}: {what}" for what in _unknown(words[0], args)]
            except SystemExit as end:
                if end.code != 0:       # --help ends, too
                    wrong.append(f"{page}: srt3d {' '.join(words)}: {capsys.readouterr().err.strip()}")
    assert not wrong, "\n".join(wrong)


def _unknown(command: str, args) -> list[str]:
    """What a parser lets pass and a node would not: configs, parameters and topics that do not exist."""
    if command != "up":
        return []
    return [*(f"no config {name}" for name in args.config
              if "/" not in name and not shared_files.find(f"config/{name}.yaml")),
            *(f"no topic {rule}" for rule in args.remap if rule.partition(":=")[0] not in TOPICS),
            *(f"no parameter {setting}" for setting in args.set if not _is_parameter(setting))]


def _is_parameter(setting: str) -> bool:
    node, _, parameter = setting.partition(":=")[0].partition(".")
    known = [one.name for one in SPECS[node].table] if node in SPECS else []
    return parameter in known or parameter.startswith(OF_EVERY_NODE)


def test_every_sub_command_and_option_that_is_named_exists(texts, capsys):
    options: dict[str, set[str]] = {}
    for command in main.COMMANDS:
        with pytest.raises(SystemExit):
            main.parser((command,)).parse_args([command, "--help"])
        options[command] = set(re.findall(r"(?<![\w-])--?[a-z][\w-]*", capsys.readouterr().out))
    top = {"--help", "--version"}
    wrong = []
    for page, text in texts.items():
        for words in [*_srt3d(text), *map(str.split, _named_inline(text))]:
            # what follows is for ROS 2 to understand
            mine = words[:words.index("--ros-args") + 1] if "--ros-args" in words else words
            known = options.get(words[0], top)
            if words[0] not in main.COMMANDS and words[0] not in top:
                wrong.append(f"{page}: srt3d has no {words[0]}")
            elif not {word.partition("=")[0] for word in mine if re.match("--?[a-z]", word)} <= known:
                wrong.append(f"{page}: srt3d {' '.join(words)}")
    assert not wrong, "\n".join(wrong)


def _named_inline(text: str):
    """The arguments of each `srt3d …` in running text."""
    return (PLACEHOLDER.split(code)[0].removeprefix("srt3d ").strip() for code in pages.inline(text)
            if re.match(r"srt3d [a-z-]", code))


def test_every_module_node_and_parameter_that_is_run_exists(texts):
    wrong = []
    for page, text in texts.items():
        for line in [*map(" ".join, pages.command_lines(text)), *pages.inline(text)]:
            if (run := re.search(r"python3? -m (srt3d_ros[\w.]*)", line)) and not importlib.util.find_spec(run[1]):
                wrong.append(f"{page}: {line}: no module {run[1]}")
            if not (run := re.search(r"(?:ros2 run srt3d_ros|srt3d node) (\w+)", line)) or run[1].isupper():
                continue
            if run[1] not in NODES:
                wrong.append(f"{page}: {line}: no node {run[1]}")
            elif unknown := [name for name in re.findall(r" -p (\w[\w./]*):=", line)
                             if not _is_parameter(f"{run[1]}.{name}")]:
                wrong.append(f"{page}: {line}: no parameter {', '.join(unknown)}")
    assert not wrong, "\n".join(wrong)


def test_every_extra_that_is_installed_exists(texts, repository, monkeypatch):
    given = {}
    monkeypatch.chdir(repository)
    monkeypatch.setattr("setuptools.setup", lambda **arguments: given.update(arguments))
    runpy.run_path("setup.py")
    named = {(page, extra) for page, text in texts.items()
             for several in re.findall(r"(?:pip install[^\n`]*?|srt3d_ros)\[([\w, -]+)\]", text)
             for extra in re.split(r",\s*", several)}
    assert len(named) > 5
    assert not [one for one in named if one[1] not in given["extras_require"]]
