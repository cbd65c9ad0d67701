"""`srt3d devices` and `srt3d device`: the list, and mistakes in one line; `srt3d reconstruct` opens a device's log."""

import json
import subprocess
import sys

import numpy as np
import pytest

from srt3d_ros.devices import DEVICES
from tests.devices import made


def test_the_list_names_every_device(srt3d):
    code, out, _ = srt3d("devices")
    assert code == 0 and all(name in out and device.sensor in out for name, device in DEVICES.items())
    listed = json.loads(srt3d("devices", "--json")[1])
    assert [one["name"] for one in listed] == list(DEVICES)
    assert [one["name"] for one in listed if one["needs"]] == ["tmf8829"]


def test_reconstruct_a_log(srt3d, tmp_path):
    slanted = np.linspace(1.0, 2.0, 16)
    log = made.tmf8829_log(tmp_path / "log.json", [made.zones_16(slanted), made.zones_16(slanted + 1)])
    out = tmp_path / "out.npz"
    code, printed, notes = srt3d("reconstruct", log, "--frame", 1, "-o", out, "--device", "cpu", "--json")
    assert code == 0 and json.loads(printed)["points"] == 256
    assert "ranges count from the reference pulse" in notes
    assert np.linalg.norm(np.load(out)["xyz"], axis=1) == pytest.approx(np.tile(slanted + 1, 16), abs=0.02)


@pytest.mark.parametrize("arguments, expected", [
    (["tmf8829", "log.json", "--connect", "tcp://127.0.0.1:1"], "an address, or else a log"),
    (["tmf882x", "--connect", "tcp://127.0.0.1:1"], "read from logs only"),
    (["nothing", "absent.json"], "tmf8829 or tmf882x"),
])
def test_mistakes_are_one_line(tmp_path, arguments, expected):
    done = subprocess.run([sys.executable, "-m", "srt3d_ros.cli.main", "device", *arguments], capture_output=True,
                          text=True, cwd=tmp_path, timeout=120)
    assert done.returncode == 2 and expected in done.stderr and done.stderr.count("\n") == 1
