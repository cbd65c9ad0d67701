"""Fuzz targets of devices: messages of their publishers, and their logs."""

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from robustness.targets import Made, Target
from robustness.targets_files import own_folder
from srt3d_ros.devices import DEVICES
from tests.devices import made

RANGES = np.linspace(1.0, 2.0, 16)
CSV = b"time," + b",".join(b"cnh__hist_bin_%d_a%d" % (k % 6, k // 6) for k in range(24)) + (
    b"\n1," + b",".join(b"%.1f" % (k % 7 - 1) for k in range(24))) * 2
LINES = b"".join(b"Aggregate %d, Ambient: 1.5, Bins: 1.0, -2.0, 3.5, 0.0, 1.0, 2.0, \n" % (k % 4) for k in range(8))


def _message() -> Made:
    zones = made.zones_16(RANGES)
    decode = DEVICES["tmf8829"].decode
    return partial(decode, stamp_ns=0), [made.message(zones), made.message(zones, parts=())]


def _log(device: str, suffix: str, examples: Callable[[Path], list[bytes]]) -> Made:
    """The bytes are all of a log."""
    path = own_folder() / f"log{suffix}"

    def read(raw: bytes) -> None:
        path.write_bytes(raw)
        for _ in DEVICES[device].read(path):
            pass

    with tempfile.TemporaryDirectory() as folder:
        return read, examples(Path(folder) / "log")


TARGETS = (
    Target("tmf8829_message", _message, 30_000),
    Target("tmf8829_log", partial(_log, "tmf8829", ".json", lambda path: [
        made.tmf8829_log(path, [made.zones_16(RANGES)]).read_bytes()]), 500),
    Target("tmf882x_log", partial(_log, "tmf882x", ".json", lambda path: [
        made.tmf882x_log(path, [9.0, 12.0]).read_bytes()]), 5_000),
    Target("vl53l8ch_log", partial(_log, "vl53l8ch", ".csv", lambda _: [CSV, LINES]), 10_000),
    Target("as_dt1_log", partial(_log, "as_dt1", ".asdt1", lambda path: [made.as_dt1_log(path, 6, 1)[0].read_bytes()]),
           200),
)
