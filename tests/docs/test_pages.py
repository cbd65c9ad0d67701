"""What the pages name exists: commands, options, parameters, topics, services, extras, identifiers, files, anchors."""

import ast
import importlib.util
import json
import re
from pathlib import Path

import pytest
import yaml

from srt3d_ros import shared_files
from srt3d_ros.cli import main
from srt3d_ros.nodes.specs import SPECS
from tests.docs import pages

ROOT = Path(__file__).resolve().parents[2]
PAGES = pages.load(ROOT)
each_page = pytest.mark.parametrize("page", PAGES)
PROGRAM = re.compile(r"(^|/bin/)srt3d$")        # also after ExecStart=, or in a container
TOPICS = {topic.name for spec in SPECS.values() for topic in (*spec.inputs, *spec.outputs)}
SERVICES = {service for spec in SPECS.values() for service in spec.services}
PARAMETERS = {name: {one.name for one in spec.table} for name, spec in SPECS.items()}
ANY_PARAMETER = set().union(*PARAMETERS.values())
OF_EVERY_NODE = ("use_sim_time", "qos_overrides.")
FOLDERS = {path.name for parent in (ROOT, ROOT / "srt3d_ros") for path in parent.iterdir() if path.is_dir()} - {
    "demo-out"}      # what was made there, if anything
SOURCES = ("srt3d_ros/**/*.py", "benchmarks/*.py", "examples/*", "msg_schemas/*.json", "launch/*", "config/*")
PUT_TOGETHER = re.compile("_per_s$|_2$")     # by the code, with a word before or after
OF_OTHERS = {"octomap_server", "sensor_frame", "bond_timeout", "sched_autogroup", "ROS_STATIC_PEERS", "IMAGE",
             "sensor_model.hit", "image_proc", "sensor.wait_for_all_acked", "ROS_SECURITY_STRATEGY"}
OPTIONS_OF_OTHERS = {"--ipc", "--network", "--shm-size", "--show-args", "--ros-args"}
OCTOMAP = {"cloud_in", "resolution", "sensor_model.max_range"}


@pytest.fixture(scope="module")
def options() -> dict[str, set[str]]:
    """The options of each sub-command."""
    known = {"--help": set(), "--version": set()}
    for command in main.COMMANDS:
        actions = main.parser((command,))._subparsers._group_actions[0].choices[command]._actions
        known[command] = {option for action in actions for option in action.option_strings}
    return known


@pytest.fixture(scope="module")
def source(repository) -> set[str]:
    """Every word of the source."""
    files = [path for pattern in SOURCES for path in repository.glob(pattern) if path.is_file()]
    return {word for path in files for word in re.findall(r"\w+", path.read_text(encoding="utf-8"))}


def codes(page: str) -> list[str]:
    """All commands and inline code of a page."""
    return [*map(" ".join, pages.command_lines(PAGES[page])), *pages.inline(PAGES[page])]


def is_parameter(name: str) -> bool:
    """Whether `NODE.parameter`, or `parameter` of any node, exists."""
    node, _, own = name.partition(".")
    if node not in (*SPECS, "NODE"):
        node, own = "", name
    return own in PARAMETERS.get(node, ANY_PARAMETER) or own.startswith(OF_EVERY_NODE)


@each_page
def test_every_command_line_parses(page, capsys):
    lines = pages.command_lines(PAGES[page])
    for words in (line[k + 1:] for line in lines for k, word in enumerate(line) if PROGRAM.search(word)):
        try:
            args = main.parser((words[0],) if words[0] in main.COMMANDS else main.COMMANDS).parse_args(words)
        except SystemExit:
            pytest.fail(f"srt3d {' '.join(words)}: {capsys.readouterr().err}")
        for name in getattr(args, "config", None) or []:
            assert "/" in name or shared_files.find(f"config/{name}.yaml"), f"no config {name}"


@each_page
def test_every_sub_command_and_option_that_is_named_in_the_text_exists(page, options):
    any_option = set().union(*options.values()) | OPTIONS_OF_OTHERS
    for code in pages.inline(PAGES[page]):
        words = re.split(r"…|\[", code)[0].split() or [""]
        assert not words[0].startswith("--") or words[0].partition("=")[0] in any_option, code
        if words[0] != "srt3d" or len(words) == 1:
            continue
        assert words[1] in options, code
        mine = words[1:words.index("--ros-args")] if "--ros-args" in words else words[1:]
        named = {word.partition("=")[0] for word in mine[1:] if re.match("--?[a-z]", word)}
        assert named <= options[words[1]] | {"--help"}, code


@each_page
def test_every_parameter_topic_and_launch_argument_that_is_set_exists(page, repository):
    launch = set(re.findall(r'"(\w+)"', (repository / "launch/srt3d.launch.py").read_text(encoding="utf-8")))
    known = TOPICS | launch | OCTOMAP | {"sketcher:sketch_size", "__ns", "__node"}
    for code in codes(page):
        for name in re.findall(r"(?:^|[ {])([\w./:]+):=", code):
            assert name in known or is_parameter(name), code
        if (run := re.search(r"(?:ros2 run srt3d_ros|srt3d node) (\w+)", code)) and run[1] != "NODE":
            assert run[1] in SPECS, code
            assert all(is_parameter(f"{run[1]}.{name}") for name in re.findall(r"-p (\w+):=", code)), code


@each_page
def test_every_service_and_identifier_exists(page, source):
    for code in pages.inline(PAGES[page]):
        if code.startswith("~/"):
            assert code[2:] in SERVICES or "/." in code or "_" not in code, code
        elif re.fullmatch(r"\w+(\.\w+)*", code) and re.search(r"[a-z]_[a-z]|[A-Z]_[A-Z]|^[A-Z]\w+\.", code):
            words = PUT_TOGETHER.sub("", code).split(".")
            assert code in OF_OTHERS or set(words) <= source or is_parameter(code), code


@each_page
def test_every_link_leads_somewhere(page, repository):
    for target in re.findall(r"\]\(([^)]+)\)", pages.FENCE.sub("", PAGES[page])):
        if target.startswith("http"):
            continue
        path, _, anchor = target.partition("#")
        file = (repository / page).parent / path if path else repository / page
        assert file.exists(), target
        if anchor:
            text = PAGES[str(file.resolve().relative_to(repository))]
            slugs = [re.sub(r"[^\w -]", "", heading[1].lower()).replace(" ", "-") for heading in pages.headings(text)]
            assert anchor in slugs, f"{target}: {slugs}"


@each_page
def test_every_file_and_module_exists(page, repository):
    text = " ".join(codes(page))
    for path in re.findall(rf"(?<![\w/.~])((?:{'|'.join(FOLDERS)})/[\w./-]*)", text):
        assert (repository / path).exists() or (repository / "srt3d_ros" / path).exists(), path
    for module in re.findall(r"python -m (srt3d_ros[\w.]*|tools[\w.]*|benchmarks \w+)", text):
        assert importlib.util.find_spec(module.replace(" ", ".")), module


@each_page
def test_every_extra_that_is_installed_exists(page, repository):
    extras = set(re.findall(r'"([\w-]+)": \[', (repository / "setup.py").read_text(encoding="utf-8")))
    for several in re.findall(r"(?:'\.|srt3d_ros)\[([\w, -]+)\]", PAGES[page]):
        assert set(re.split(r",\s*", several)) <= extras


@each_page
def test_every_block_of_code_parses(page):
    for language, parse in (("python", ast.parse), ("json", json.loads), ("yaml", yaml.safe_load)):
        for block in pages.fenced(PAGES[page], language):
            parse(block)


def test_the_library_as_in_the_readme(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(pages.fenced(PAGES["docs/photon-file.md"], "python")[0], {})
    Path("photons.npz").rename("head.npz")
    names: dict = {}
    exec(pages.fenced(PAGES["README.md"], "python")[0], names)
    assert len(names["cloud"]) > 1000
