"""Faults of the machine: its disk, its shared memory. Each sees that it was done, and takes it back; see faults.py."""

import os
import random
import time

from faults_nodes import CLEAR_S, NODES, end
from faulty import FaultyStack
from std_srvs.srv import Trigger

MB = 2**20
LEAKED_MB, OLD_S = 40, 100.0
FULL_S = 60.0               # until the recorder has nothing more to flush and finds out


def disk_full(stack: FaultyStack, choice: random.Random) -> dict:
    """No room for the recording: one error, clouds go on; with room again, a new file."""
    errors, path = stack.counts.totals("recorder")["errors"], stack.value("recorder", "path")
    stack.disk.fill()
    try:
        stack.wait(lambda: stack.counts.totals("recorder")["errors"] > errors, "the recorder to say so", FULL_S)
        stack.wait_for_cloud(CLEAR_S)
    finally:
        stack.disk.empty()
    stack.wait(lambda: stack.value("recorder", "path") not in ("", path), "the recording to go on", FULL_S)
    return {"errors": stack.counts.totals("recorder")["errors"] - errors}


def disk_read_only(stack: FaultyStack, choice: random.Random) -> dict:
    """A recording is finished, and the next begun on a disk that is read-only by now."""
    errors = stack.counts.totals("recorder")["errors"]
    trigger(stack, "recorder/stop_recording")
    stack.disk.read_only(True)
    try:
        trigger(stack, "recorder/start_recording", either=True)
        stack.wait(lambda: stack.counts.totals("recorder")["errors"] > errors, "the recorder to say so", FULL_S)
        stack.wait_for_cloud(CLEAR_S)
    finally:
        stack.disk.read_only(False)
    recorded = stack.counts.totals("recorder")["frames_out"]
    stack.wait(lambda: stack.counts.totals("recorder")["frames_out"] > recorded + 5, "the recording to go on", FULL_S)
    return {"errors": stack.counts.totals("recorder")["errors"] - errors}


def trigger(stack: FaultyStack, service: str, either: bool = False) -> None:
    """Call a service that must succeed, unless `either` way is right."""
    answer = stack.call(Trigger, service, Trigger.Request())
    assert answer.success or either, f"{service}: {answer.message}"


def shared_memory_full(stack: FaultyStack, choice: random.Random) -> dict:
    """No room in /dev/shm, for those who run and for one who starts."""
    name = choice.choice((*NODES, "driver"))
    stack.shared_memory.fill()
    try:
        stack.wait_for_cloud(CLEAR_S)
        end(stack, name)
        stack.shared_memory.fill()
        stack.again(name)
        free = stack.shared_memory.free_bytes
        stack.wait_for_cloud(CLEAR_S)
    finally:
        stack.shared_memory.empty()
    return {"node": name, "free_mb": free // MB}


def shared_memory_leaked(stack: FaultyStack, choice: random.Random) -> dict:
    """/dev/shm full of what killed processes left: who starts gives it back."""
    name = choice.choice((*NODES, "driver"))
    leaked = []
    while stack.shared_memory.free_bytes > LEAKED_MB * MB:
        path = stack.shared_memory.folder / f"fastrtps_{choice.getrandbits(64):016x}"
        for part, size in ((path, LEAKED_MB * MB), (path.with_name(f"{path.name}_el"), 0)):
            with part.open("wb") as file:
                if size:
                    os.posix_fallocate(file.fileno(), 0, size)
            os.utime(part, (time.time() - OLD_S,) * 2)
        leaked.append(path)
    assert leaked, "there was no room to leak"
    end(stack, name)
    stack.again(name)
    left = [path for path in leaked if path.exists()]
    assert not left, f"{len(left)} of {len(leaked)} leaked segments are there still"
    return {"node": name, "leaked_mb": LEAKED_MB * len(leaked)}
