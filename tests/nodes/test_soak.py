"""The half hour of scripts/attacks/soak.py in seconds: nothing grows, nothing stays open, nothing is lost."""

import json
import subprocess
import sys

import pytest

from scripts.attacks.process import REPOSITORY

SOAK = REPOSITORY / "scripts" / "attacks" / "soak.py"
NODES = ("player", "sketcher", "reconstructor", "recorder")


@pytest.mark.skipif(sys.platform != "linux", reason="what processes hold is read from /proc")
def test_what_the_nodes_hold_does_not_grow_and_every_frame_is_recorded(photon_file, tmp_path):
    """The latency is judged too, but only on a machine that does nothing else."""
    done = subprocess.run(
        [sys.executable, SOAK, "--minutes", "0.25", "--warm-up-minutes", "0.1", "--input", photon_file, "--lossless",
         "--growth-percent", "10", "--out", tmp_path / "soak.json"],
        cwd=REPOSITORY, capture_output=True, text=True, timeout=300)
    assert (tmp_path / "soak.json").exists(), done.stdout + done.stderr
    seen = json.loads((tmp_path / "soak.json").read_text())
    verdicts = {line["what"]: line for line in seen["verdicts"]}
    assert [line for what, line in verdicts.items() if not line["holds"] and "latency" not in what] == []
    assert {f"{name}, {kind}" for name in NODES for kind in ("memory", "fds", "threads")} < verdicts.keys()
    assert verdicts["frames sent"]["seen"] == "150" and len(seen["samples"]["time_s"]) == 14
    assert len(list((tmp_path / "soak").glob("*.rrd"))) == 1      # of at least two: the first is kept for who looks
