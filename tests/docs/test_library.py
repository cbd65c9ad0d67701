"""The Python code of the pages and of the notebook runs, from the first line to the last."""

import inspect
import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from srt3d_ros import api
from srt3d_ros.datasets.simulation.simulator import Simulator

from .pages import PAGES, ROOT, fenced


@pytest.fixture(autouse=True)
def names(tmp_path, monkeypatch) -> dict:
    """The arrays and the file that the pages take as given, in a folder of their own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    simulator = Simulator(ppp=5)
    events, _ = simulator.frame(0)
    sensor = simulator.sensor
    np.savez("head.npz", rows=141, cols=141, num_bins=4613, bin_width_s=2e-12, pixel=events.pixel, toa=events.toa,
             irf=sensor.irf, irf_ref=sensor.irf_ref)
    row, col = np.divmod(events.pixel, 141)
    cube = np.zeros((24, 20, 4613), np.uint8)
    near = (row < 24) & (col < 20)
    np.add.at(cube, (row[near], col[near], events.toa[near]), 1)
    return {"row": row, "col": col, "toa": events.toa, "irf": sensor.irf, "cube": cube}


@pytest.mark.parametrize("page", ["docs/api.md", "README.md", "docs/photon-file.md"])
def test_the_code_of_a_page_runs_and_makes_the_files_that_it_names(names, page):
    for block in fenced(PAGES[page], "python"):
        exec(block, names)
        assert page == "docs/photon-file.md" or len(names["cloud"]) > 400
        assert all(Path(name).exists() for name in re.findall(r'"(\w+\.(?:npz|png|ply))"', block))


@pytest.mark.parametrize("one", [getattr(api, name) for name in api.__all__], ids=api.__all__)
def test_help_tells_every_argument_and_field(one):
    told = " ".join(inspect.getdoc(part) or "" for part in (inspect.getmro(one) if inspect.isclass(one) else [one]))
    assert [name for name in inspect.signature(one).parameters if not re.search(rf"\b{name}\b[\w, ]*:", told)] == []


def test_the_notebook_runs_and_keeps_no_output(monkeypatch, capsys):
    display = SimpleNamespace(Image=lambda filename: filename)
    ipython = SimpleNamespace(display=display, version_info=(9, 0), get_ipython=str)        # as a kernel has it
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    cells, names = json.loads((ROOT / "docs" / "arrays.ipynb").read_text(encoding="utf-8"))["cells"], {}
    for cell in [cell for cell in cells if cell["cell_type"] == "code"]:
        assert cell["outputs"] == [] and cell["execution_count"] is None
        exec("".join(cell["source"]), names)
    half = float(capsys.readouterr().out.split("half of the points are within ")[1].split()[0])
    assert half < 0.5 and len(names["cloud"]) > 19_000 and Image.open("cloud.gif").n_frames == 16
