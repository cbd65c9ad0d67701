"""Processes that this one has started."""

import subprocess


def wait_or_kill(process: subprocess.Popen, timeout_s: float) -> None:
    """Wait for a process that has been told to end; after `timeout_s` end it."""
    try:
        process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
