"""The site builds, and what a page names exists: commands, options, parameters, topics, identifiers, files, extras."""

import re
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

from srt3d_ros.cli import main
from srt3d_ros.shared_files import find

from .pages import PAGES, ROOT, SOURCE, command_lines, inline

FOLDERS = ("benchmarks", "config", "docs", "examples", "launch", "msg_schemas", "scripts", "tests", "tools",
           *(folder.name for folder in (ROOT / "srt3d_ros").iterdir() if folder.is_dir()))
OF_OTHERS = {"octomap_server", "sensor_frame", "bond_timeout", "ROS_STATIC_PEERS", "IMAGE", "sensor_model",
             "wait_for_all_acked", "--show-args", "--ros-args", "use_sim_time", "__ns", "cloud_in", "max_range",
             "--system-site-packages"}
LIKE_CODE = re.compile(r"[a-z]_[a-z]|[A-Z]_[A-Z]|^[A-Z]\w+\.")

# Figures of a page that are in docs/RESULTS.md, too: the page, what stands around them there, and in the results.
REPEATED = (
    ("README.md", said := r"^\| \S+, (?:this|the|its|a) .*$", said),
    ("README.md", said := r"xcorr takes (\d+) times and rt3d (\d+) times", said),
    ("docs/calibration.md", said := r"`flat` finds ([\d.]+) %.*?`auto` ([\d.]+) %.*?frame\s+([\d.]+) %", said),
    ("docs/deployment.md", said := r"(\d+) ms with int16", said),
    ("docs/evaluation.md", said := r"^\| (?:pooled|srt3d|smle|xcorr|rt3d|sketching) .*$", said),
    ("docs/evaluation.md", r"141² pixels takes (\d+) ms", r"^\| 141² (?:\|[^|]+){3}\| \*\*(\d+) ms"),
    ("docs/evaluation.md", r"705² pixels (\d+) ms and (\d+) MB", r"^\| 705² .*?\*\*.*?\*\*(\d+) ms.*?(\d+) MB"),
    ("docs/evaluation.md", r"take (\d+) ms \(median; 95 %: (\d+)\)", r"30 Hz \| (\d+) / (\d+) ms"),
    ("docs/motion.md", said := r"have ([\d.]+) to ([\d.]+) times the depth", said),
)
VARIABLE = (r'…|[\d.]+|/\w+|"\w+"|[:,;()]|\b(is|are|of|on|expected|no_sensor|malformed|queue|my_sensor.json)\b')
PUT_TOGETHER = {"waiting for a sensor description", "waiting for a frame"}      # of words


def names(code: str) -> Iterator[str]:
    """What is set in a piece of code, the options of `srt3d` in it, or the identifiers that it is."""
    yield from re.findall(r"(\w+):=", code)
    if code.startswith(("--", "srt3d ")):
        yield from re.findall(r"(?<!\S)--[a-z-]+", code)
    elif re.fullmatch(r"(~/)?\w+(\.\w+)*", code) and LIKE_CODE.search(code):
        yield from re.findall(r"\w+", re.sub("_per_s$|_2$", "", code))     # which the code puts behind words


def wrong_commands(text: str) -> Iterator[str]:
    """Command lines that `srt3d` does not take; also after ExecStart=, or in a container."""
    for line in command_lines(text):
        if srt3d := [k for k, word in enumerate(line) if Path(word).name == "srt3d"]:
            words = line[srt3d[0] + 1:]
            try:
                config = getattr(main.parser(words[:1]).parse_args(words), "config", None)
            except SystemExit:
                yield " ".join(line)
            else:
                yield from (name for name in config or () if "/" not in name and not find(f"config/{name}.yaml"))


def wrong_files(text: str) -> Iterator[str]:
    """Files, modules and extras that are not there."""
    for path in re.findall(rf"(?<![\w/.~])((?:{'|'.join(FOLDERS)})/[\w./-]*)", text):
        if not (ROOT / path).exists() and not (ROOT / "srt3d_ros" / path).exists():
            yield path
    modules = re.findall(r"python -m (srt3d_ros[\w.]*|tools[\w.]*|benchmarks \w+)", text)
    yield from (module for module in modules if not find_spec(module.replace(" ", ".")))
    extras = re.findall(r'"([\w-]+)": \[', (ROOT / "setup.py").read_text(encoding="utf-8"))
    for several in re.findall(r"(?:(?<!\S)\.|srt3d_ros)\[([\w, -]+)\]", text):
        yield from set(re.split(r",\s*", several)) - set(extras)


@pytest.mark.parametrize("page", PAGES)
def test_what_the_page_names_exists(page):
    known = OF_OTHERS.union(re.findall(r"--[a-z-]+|\w+", SOURCE))
    codes = [*map(" ".join, command_lines(PAGES[page])), *inline(PAGES[page])]
    assert {name for code in codes for name in names(code)} <= known
    assert [*wrong_commands(PAGES[page]), *wrong_files(" ".join(codes))] == []
    links = re.findall(r"\]\((?!http)([^)#]+)", PAGES[page])
    assert [link for link in links if not ((ROOT / page).parent / link).exists()] == []


@pytest.mark.parametrize("page, there, here", REPEATED)
def test_a_page_repeats_the_results(page, there, here):
    results = (ROOT / "docs/RESULTS.md").read_text(encoding="utf-8")
    said, measured = (re.findall(text, found, re.MULTILINE) for text, found in ((there, PAGES[page]), (here, results)))
    assert said and set(said) <= set(measured)


def test_the_tables_of_troubles_quote_the_source():
    """tests/nodes has the causes: silence, clocks, contradictions, bad messages, losses, overload."""
    source = re.sub(r'"\s*\n\s*f?"', "", SOURCE)          # literals of several lines
    quoted = [code for code in inline(PAGES["docs/troubleshooting.md"])
              if len(code.split()) > 2 and not code.startswith(("ros2", "srt3d"))]
    parts = {part.strip() for message in quoted for part in re.sub(VARIABLE, "\n", message).splitlines()}
    assert len(quoted) > 15 and {part for part in parts if part not in source} == PUT_TOGETHER


def test_the_site_builds_without_a_warning_and_reads_offline(tmp_path):
    build = [sys.executable, "-m", "sphinx", "-W", "-q", "-d", tmp_path / "tmp", "docs", tmp_path / "site"]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    pages = [page.read_text(encoding="utf-8") for page in (tmp_path / "site").glob("*.html")]
    assert len(pages) > len(list(ROOT.glob("docs/*.md"))) and not any(re.search('src="http', page) for page in pages)
