"""The commands and the Python of every page run, in a folder with the files that the pages take as given."""

import json
import re
import signal
from pathlib import Path

import numpy as np
import pytest

from srt3d_ros.cli import main
from srt3d_ros.datasets import photon_file, read
from tests.processes import Process

from .conftest import HEAD, HOT, TRUE
from .pages import PAGES, ROOT, command_lines, fenced

FILES, NODES = {"info", "convert", "reconstruct", "evaluate", "review"}, {"up", "node", "play"}
NOT_HERE = {"srt3d evaluate --out eval",            # too long, or without a GPU
            "srt3d evaluate --ppp 1 3 10 30 100 300 1000 --sketch-size 5 10 20 --out eval",
            "srt3d reconstruct simulator -o head.png --device cuda"}
ELSEWHERE = ("IncludeLaunchDescription", "my_sensor.json")      # code of test_launch.py, test_quickstart.py
LIVE = ("docs/quickstart.md", "docs/motion.md")         # whose nodes are started; those of others: test_pages.py
DONE: set[str] = set()


def run(page: str) -> None:
    """Run the Python of a page, then its commands that take files, unless another page has the same."""
    row, col = np.divmod(HEAD.frame(0)[0].pixel, 141)
    cube = np.random.default_rng(0).poisson(0.01, (24, 20, 4613)).astype(np.uint8)
    if page == "docs/api.md":               # which takes a window of 100 pixels
        photon_file.save("head.npz", HEAD.sensor, HEAD.frame(0)[0])
    names = {"row": row, "col": col, "toa": HEAD.frame(0)[0].toa, "irf": HEAD.sensor.irf, "cube": cube}
    for block in fenced(PAGES[page], "python"):
        if not any(word in block for word in ELSEWHERE):
            exec(block, names)
            assert "cloud" not in names or len(names["cloud"]) > 400
            assert all(Path(name).exists() for name in re.findall(r'"(\w+\.(?:npz|png|ply))"', block))
    for line in command_lines(PAGES[page]):
        text = " ".join(line)
        if line[0] == "srt3d" and line[1] in FILES and text not in DONE | NOT_HERE:
            assert main.main(line[1:]) == 0, line
            assert all(Path(line[k + 1]).exists() for k, word in enumerate(line) if word in ("-o", "--out")), line
            DONE.add(text)


@pytest.mark.parametrize("page", sorted(PAGES.keys() - {"docs/calibration.md"}))
def test_the_commands_and_the_code_of_a_page_run(here, page):
    run(page)
    lines = [["srt3d", "node", *line[3:]] if line[:3] == ["ros2", "run", "srt3d_ros"] else line
             for line in command_lines(PAGES[page])]        # ros2 run is not among the wheels
    nodes = [Process(line) for line in lines if line[0] == "srt3d" and line[1] in NODES and page in LIVE]
    try:
        for node in nodes:
            assert node.ready().end(signal.SIGINT) == 0 and "Traceback" not in node.text, node.text
    finally:
        for node in nodes:
            node.stop()


def test_the_calibration_finds_what_the_sensor_is(here):
    run("docs/calibration.md")
    found = read("calibrated.npz").sensor
    used = found.mask
    assert np.flatnonzero(~used).tolist() == np.sort(HOT).tolist()
    gain, late = found.gain[used] / TRUE.gain[used], (found.delay_bins - TRUE.delay_bins)[used]
    assert (gain / gain.mean()).std() < 0.04 and np.abs(late).mean() < 0.3
    assert np.abs(np.cumsum(found.background_shape) - np.cumsum(TRUE.background_shape)).max() < 0.03


def test_the_notebook_prints_what_is_stored(here, capsys):
    names: dict = {}
    for cell in json.loads((ROOT / "docs/arrays.ipynb").read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
            stored = ["".join(one["text"]) for one in cell["outputs"] if one.get("name") == "stdout"]
            assert capsys.readouterr().out == "".join(stored)
