"""Processes that die under a batch or are interrupted: nothing is lost, nothing waits for the dead."""

import os
import signal
from functools import partial
from pathlib import Path

from srt3d_ros.batch.executors import LocalProcesses, done
from srt3d_ros.errors import InvalidInput


def end(how: str, marker: Path) -> int:
    """Do as asked in a process; "once": be killed the first time."""
    if how == "killed" or how == "once" and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if how == "refused":
        raise InvalidInput("toa", {1}, "bins")
    if how == "missing":
        raise ModuleNotFoundError("no", name="rerun")
    return os.getpid()


def test_what_a_killed_process_did_is_done_once_more_by_another(tmp_path):
    said = []
    processes = LocalProcesses(2, said.append)
    how = ("once", "well", "killed", "refused", "missing", *["well"] * 6)
    try:
        found = {call.args: future for call, future in
                 done((partial(end, what, tmp_path / f"{k}") for k, what in enumerate(how)), processes)}
    finally:
        processes.close()
    errors = [found[what, tmp_path / f"{k}"].exception() for k, what in enumerate(how)]
    assert [type(error).__name__ for error in errors[2:5]] == ["BrokenProcessPool", "InvalidInput",
                                                               "ModuleNotFoundError"]
    assert str(errors[3]) == "toa is {1}: expected bins" and errors[4].name == "rerun"
    assert not any(errors[:2] + errors[5:]) and said
    assert os.getpid() not in {future.result() for future in found.values() if not future.exception()}


def test_closing_ends_processes_whatever_they_do():
    processes = LocalProcesses(1, print)
    waiting = [processes.submit(signal.pause) for _ in range(5)]
    processes.close()
    assert all(future.cancelled() or future.exception(60) for future in waiting)
