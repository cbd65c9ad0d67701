"""Processes that die under a batch: the others' work is kept, theirs is done again, and nothing waits for the dead."""

import os
import signal
from pathlib import Path

import pytest

from srt3d_ros.batch.executors import LocalProcesses, ProcessDied
from srt3d_ros.errors import InvalidInput


def end(how: str, marker: str) -> int:
    """Do as asked in a process; "once": be killed the first time."""
    if how == "killed" or how == "once" and not Path(marker).exists():
        Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if how == "refused":
        raise InvalidInput("toa", {1}, "bins")
    if how == "missing":
        raise ModuleNotFoundError("no", name="rerun")
    return os.getpid()


def test_what_a_killed_process_did_is_done_once_more_by_another(tmp_path):
    said = []
    processes = LocalProcesses(2, said.append)
    try:
        how = ("once", "well", "killed", "refused", "missing", *["well"] * 6)
        futures = [processes.submit(end, what, str(tmp_path / what)) for what in how]
        with pytest.raises(ProcessDied, match="was killed by SIGKILL, 2 times"):
            futures[2].result(60)
        with pytest.raises(InvalidInput, match=r"^toa is \{1\}: expected bins$"):
            futures[3].result(60)
        with pytest.raises(ModuleNotFoundError) as missing:
            futures[4].result(60)
        assert missing.value.name == "rerun"
        assert all(futures[k].result(60) != os.getpid() for k in (0, 1, *range(5, 11)))
        assert said == ["a process was killed by SIGKILL: another takes its place"] * 3
    finally:
        processes.close()


def test_closing_ends_processes_whatever_they_do():
    processes = LocalProcesses(1, print)
    waiting = processes.submit(signal.pause)
    later = processes.submit(os.getpid)
    processes.close()
    assert isinstance(waiting.exception(60), EOFError | OSError) and later.cancelled()
