"""Processes that die under a batch or are interrupted: nothing is lost, nothing waits for the dead."""

import multiprocessing
import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import psutil

from srt3d_ros.batch.executors import LocalProcesses, done
from srt3d_ros.errors import InvalidInput
from srt3d_ros.processes import wait


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
    assert not any(errors[:2] + errors[5:])
    assert set(said) == {"a process died (too little memory?): others take over"}
    assert os.getpid() not in {future.result() for future in found.values() if not future.exception()}


def test_closing_ends_processes_whatever_they_do():
    processes = LocalProcesses(1, print)
    waiting = [processes.submit(signal.pause) for _ in range(5)]
    begun = multiprocessing.active_children()
    processes.close()
    assert all(future.cancelled() or future.exception(60) for future in waiting)
    assert begun and not any(process.is_alive() for process in begun)


def test_processes_end_with_a_parent_that_is_killed():
    code = ("import multiprocessing, signal\nfrom srt3d_ros.batch.executors import LocalProcesses\n"
            "if __name__ == '__main__':\n    processes = LocalProcesses(1, print)\n"
            "    processes.submit(int).result()\n    processes.submit(signal.pause)\n"
            "    print(multiprocessing.active_children()[0].pid, flush=True)\n    signal.pause()")
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as parent:
        worker = psutil.Process(int(parent.stdout.readline()))
        parent.kill()
    wait(lambda: not worker.is_running() or worker.status() == psutil.STATUS_ZOMBIE, "the end of the worker")
