"""Starts and ends child processes."""

import ctypes
import os
import signal
import subprocess
import sys
from typing import Any

STOP_TIMEOUT_S = 60.0       # to write the rest of a recording or a bag
LIBC, PR_SET_PDEATHSIG = ctypes.CDLL(None), 1       # linux/prctl.h


def start(command: list[str], **options: Any) -> subprocess.Popen:
    """Start a child that Ctrl-C in the terminal does not reach, and that receives SIGTERM when this process ends."""
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, process_group=0,
                            preexec_fn=lambda: LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGTERM), **options)


def stop(process: subprocess.Popen, timeout_s: float = STOP_TIMEOUT_S) -> None:
    """Terminate a process; kill it after `timeout_s`."""
    process.terminate()         # not SIGINT, which gives a traceback while Python starts
    try:
        process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def end_at_once(code: int) -> None:
    """End this process without running the other exit handlers, which may wait for ever."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def ending(process: subprocess.Popen | subprocess.CompletedProcess) -> str:
    """How a process ended, in words."""
    code = process.returncode
    return f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
