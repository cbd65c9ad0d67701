"""The site builds, and pages name commands, options, parameters, files, extras, messages and figures that exist."""

import contextlib
import io
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml

from srt3d_ros.cli import main, up
from srt3d_ros.errors import InvalidInput
from srt3d_ros.nodes import all_specs
from srt3d_ros.nodes.common.topics import NodeSpec

from .pages import PAGES, ROOT, command_lines, inline, section

FOLDERS = ("benchmarks", "config", "docs", "examples", "launch", "msg_schemas", "scripts", "tests", "tools",
           *(folder.name for folder in (ROOT / "srt3d_ros").iterdir() if folder.is_dir()))
PARSER = main.parser(main.COMMANDS)
PARAMETERS = {one.name for spec in all_specs().values() for one in spec.table} | {"use_sim_time"}     # of any ROS node

# Parts of a quoted message that differ from case to case.
VARIABLE = (r'…|[\d.]+|/\w+|"\w+"|[:,;()]|waiting for'
            r"|\b(is|are|of|on|expected|no_sensor|malformed|queue|my_sensor.json)\b")


@pytest.fixture(scope="module")
def options() -> set[str]:
    """The options of all `srt3d` commands, from their help."""
    with contextlib.redirect_stdout(io.StringIO()) as output:
        for command in main.COMMANDS:
            with contextlib.suppress(SystemExit):
                main.main([command, "--help"])
    return set(re.findall(r"--[a-z][a-z-]*", output.getvalue()))


def wrong_commands(text: str) -> Iterator[str]:
    """Commands that `srt3d` or a node refuses; also after ExecStart=, or in a container."""
    for line in command_lines(text):
        at = [k for k, word in enumerate(line) if Path(word).name == "srt3d" or word == "srt3d_ros"]
        words = ["node"] * (line[:2] == ["ros2", "run"]) + line[at[0] + 1:] if at else []
        try:
            args = PARSER.parse_args(words) if words and words[0] != "srt3d.launch.py" else None
            if words[:1] == ["up"]:
                up.ros_arguments(args, up.parameters_yaml(args))
                for node, _, setting in (given.partition(".") for given in args.set):
                    check_settings(all_specs()[node], ["-p", setting])
            elif words[:1] == ["node"]:
                check_settings(all_specs()[args.name], args.ros_args)
        except (SystemExit, KeyError, InvalidInput) as error:
            yield f"{' '.join(line)}: {error}"


def check_settings(spec: NodeSpec, ros_args: list[str]) -> None:
    """Raise KeyError for a topic or a parameter that the node does not have, InvalidInput for a wrong value."""
    parameters = {parameter.name: parameter for parameter in spec.table}
    for flag, (name, _, value) in zip(ros_args, (word.partition(":=") for word in ros_args[1:]), strict=False):
        if flag == "-r":
            {topic.name: topic for topic in (*spec.inputs, *spec.outputs)}[name]
        elif flag == "-p":
            parameters[name].check(yaml.safe_load(value))


def wrong_files(text: str) -> Iterator[str]:
    """Files, modules and extras that do not exist."""
    for path in re.findall(rf"(?<![\w/.~])((?:{'|'.join(FOLDERS)})/[\w./-]*)", text):
        if not (ROOT / path).exists() and not (ROOT / "srt3d_ros" / path).exists():
            yield path
    modules = re.findall(r"python -m (srt3d_ros[\w.]*|tools[\w.]*|benchmarks \w+)", text)
    yield from (module for module in modules if not find_spec(module.replace(" ", ".")))
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for several in re.findall(r"(?:(?<!\S)\.|srt3d_ros)\[([\w, -]+)\]", text):
        yield from set(re.split(r",\s*", several)) - set(extras)


@pytest.mark.parametrize("page", PAGES)
def test_what_the_page_names_exists(page, options):
    codes = [*map(" ".join, command_lines(PAGES[page])), *inline(PAGES[page])]
    assert [*wrong_commands(PAGES[page]), *wrong_files(" ".join(codes))] == []
    named = {option for code in codes if code.startswith("srt3d ") for option in re.findall(r"(?<!\S)--[a-z-]+", code)}
    assert named <= options
    assert {name for code in inline(PAGES[page]) for name in re.findall(r"^(\w+):=", code)} <= PARAMETERS


def test_each_step_of_a_packet_is_where_the_architecture_says():
    rows = [row.split(" | ")[1:] for row in section(PAGES["docs/architecture.md"], "A packet").splitlines()
            if row.startswith("| ") and ".py`" in row]
    assert len(rows) > 15
    for files, functions in rows:
        code = "".join((ROOT / "srt3d_ros" / file).read_text(encoding="utf-8") for file in re.findall("`(.+?)`", files))
        missing = [name for name in re.findall(r"\w+", "".join(re.findall("`.+?`", functions)))
                   if not re.search(rf"(?m)(def|class) {name}\b|^{name} = |^    {name}: ", code)]
        assert missing == [], files


def test_the_readme_repeats_the_results():
    results = (ROOT / "docs/RESULTS.md").read_text(encoding="utf-8")
    for figures in (r"^\| \S+, (?:this|the|its|a) .*$", r"xcorr takes (\d+) times and rt3d (\d+) times"):
        quoted, measured = (set(re.findall(figures, text, re.MULTILINE)) for text in (PAGES["README.md"], results))
        assert quoted and quoted <= measured


def test_troubleshooting_quotes_the_messages_of_the_nodes():
    """Each message in the tables has the words of the code; tests/nodes makes the nodes say them."""
    sources = "\n".join(path.read_text(encoding="utf-8") for path in ROOT.glob("srt3d_ros/**/*.py"))
    source = re.sub(r'"\s*\n\s*f?"', "", sources)          # join string literals of several lines
    quoted = [code for code in inline(PAGES["docs/troubleshooting.md"])
              if len(code.split()) > 2 and not code.startswith(("ros2", "srt3d"))]
    parts = {part.strip() for message in quoted for part in re.sub(VARIABLE, "\n", message).splitlines()}
    assert len(quoted) > 15 and {part for part in parts if part not in source} == set()


# Sphinx, where packages that `make docs` does not install are missing.
BUILD = """import sys; from sphinx.cmd.build import main
sys.modules.update(dict.fromkeys(["rclpy", "rerun", "matplotlib", "rosbags", "ptufile", "torch"])); sys.exit(main())"""


def test_the_site_builds_without_a_warning_and_reads_offline(tmp_path):
    """Warnings: broken links, anchors and references between pages, and of the docstrings to names of the API."""
    build = [sys.executable, "-c", BUILD, "-W", "-q", "-d", tmp_path / "tmp", "docs", tmp_path / "site"]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    pages = {page.stem: page.read_text(encoding="utf-8") for page in (tmp_path / "site").glob("*.html")}
    assert len(pages) > len(list(ROOT.glob("docs/*.md"))) and not any('src="http' in page for page in pages.values())
    assert r"\[Q_p(t, r)" in pages["algorithm"] and "bin_width_s: float" in re.sub("<[^>]+>", "", pages["api"])
