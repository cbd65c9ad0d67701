"""The code on the library's page and in its notebook runs, from the first line to the last."""

import inspect
import json
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from srt3d_ros import api
from srt3d_ros.datasets.readers import npz
from srt3d_ros.datasets.simulation.simulator import Simulator
from tests.docs import pages


@pytest.fixture
def names(tmp_path, monkeypatch) -> dict:
    """The arrays and the file that the page takes as given, in a folder of their own."""
    monkeypatch.chdir(tmp_path)
    simulator = Simulator(ppp=5)
    events, _ = simulator.frame(0)
    npz.save("head.npz", simulator.sensor, events)
    row, col = np.divmod(events.pixel, 141)
    cube = np.zeros((24, 20, 4613), np.uint8)
    near = (row < 24) & (col < 20)
    np.add.at(cube, (row[near], col[near], events.toa[near]), 1)
    return {"row": row, "col": col, "toa": events.toa, "irf": simulator.sensor.irf, "cube": cube}


def test_the_page(repository, names, tmp_path):
    for block in pages.fenced((repository / "docs" / "api.md").read_text(encoding="utf-8"), "python"):
        exec(block, names)
        assert len(names["cloud"]) > 400
    assert (names["cloud"].sensor.rows, names["cloud"].sensor.cols) == (100, 80)
    assert {path.name for path in tmp_path.iterdir()} == {"head.npz", "cloud.png", "cloud.ply", "face.npz"}


@pytest.mark.parametrize("one", [getattr(api, name) for name in api.__all__], ids=api.__all__)
def test_help_tells_every_argument_and_field(one):
    told = " ".join(inspect.getdoc(part) or "" for part in (inspect.getmro(one) if inspect.isclass(one) else [one]))
    assert [name for name in inspect.signature(one).parameters if not re.search(rf"\b{name}\b[\w, ]*:", told)] == []


def test_the_notebook_runs_and_keeps_no_output(repository, tmp_path, monkeypatch, capsys):
    notebook = json.loads((repository / "docs" / "arrays.ipynb").read_text(encoding="utf-8"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    shown = []
    display = SimpleNamespace(Image=lambda filename: shown.append(filename))        # a kernel has IPython
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(display=display, get_ipython=lambda: None))
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    names: dict = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == [] and cell["execution_count"] is None
            exec("".join(cell["source"]), names)
    half = float(capsys.readouterr().out.split("half of the points are within ")[1].split()[0])
    assert half < 0.5 and len(names["cloud"]) > 19_000 and shown == ["cloud.gif"]
    with Image.open("cloud.gif") as film:
        assert film.n_frames == 16 and film.size == (480, 360)
