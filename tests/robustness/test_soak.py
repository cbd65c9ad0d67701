"""`python -m robustness soak` in seconds: nothing grows, nothing stays open, nothing is lost."""

import json
import subprocess
import sys

import pytest

from robustness.targets_files import photon_file

NODES = ("player", "sketcher", "reconstructor", "recorder")


@pytest.mark.skipif(sys.platform != "linux", reason="what processes hold is read from /proc")
def test_what_the_nodes_hold_does_not_grow_and_every_frame_is_recorded(repository, tmp_path):
    """The latency is judged too, but only on a machine that does nothing else."""
    (tmp_path / "photons.npz").write_bytes(photon_file())
    done = subprocess.run(
        [sys.executable, "-m", "robustness", "soak", "--seconds", "15", "--lossless", "--growth-percent", "10",
         "--input", tmp_path / "photons.npz", "--out", tmp_path / "soak.json"],
        cwd=repository, capture_output=True, text=True, timeout=300)
    assert (tmp_path / "soak.json").exists(), done.stdout + done.stderr
    summary = json.loads((tmp_path / "soak.json").read_text())
    assert [line for line in summary["failed"] if not line.startswith("latency")] == []
    held = {f"{name}, {kind}" for name in NODES for kind in ("memory in MB", "files", "threads")}
    assert held < summary["seen"].keys()
    assert summary["seen"]["frames"].startswith("150 asked for, 150 sent, 150 clouds, 150 in ")
    assert len(list((tmp_path / "soak").glob("*.rrd"))) == 1      # the first is kept to be looked at
