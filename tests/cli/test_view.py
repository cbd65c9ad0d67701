"""`srt3d view`: the viewer where there is a screen, else a line."""

import os
from pathlib import Path

import numpy as np
import pytest

from srt3d_ros.cli import main
from srt3d_ros.recording.writer import RecordingWriter


@pytest.fixture
def opened(monkeypatch):
    """The arguments with which the viewer is started, in place of this process."""
    seen = []
    def execv(path, arguments):
        seen[:] = arguments
        raise SystemExit

    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(main, "COMMANDS", ("view",))
    monkeypatch.setattr(os, "execv", execv)
    return seen


@pytest.fixture
def recording(tmp_path) -> Path:
    with RecordingWriter(tmp_path / "a.rrd", None) as writer:
        writer.log_cloud(0, 0, np.ones((10, 3)), np.ones(10))
    return tmp_path / "a.rrd"


def test_what_cannot_be_shown_is_one_line(refusal, opened, tmp_path, recording):
    (tmp_path / "named.rrd").write_text("# words")
    for arguments, said in (
            ([], "the following arguments are required: RECORDING"),
            (["absent.rrd"], "recording is absent.rrd: expected an .rrd file that exists"),
            ([recording, tmp_path / "named.rrd"], "named.rrd: expected an .rrd file, as the recorder writes it"),
            ([recording], "DISPLAY is not set: expected a screen; copy")):
        assert said in refusal("view", *arguments) and not opened


def test_where_there_is_a_screen_the_viewer_opens_and_is_reached_from_this_machine_alone(srt3d, monkeypatch, opened,
                                                                                       recording):
    monkeypatch.setenv("DISPLAY", ":0")
    srt3d("view", recording, recording)
    assert Path(opened[0]).name == "rerun" and opened[1:] == ["--bind", "127.0.0.1", str(recording), str(recording)]
