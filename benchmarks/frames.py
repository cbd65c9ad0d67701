"""Shared by the benchmarks: frames of the simulated head, and the times and memory of calls."""

import ctypes
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets.simulation.scene import default_sensor
from srt3d_ros.datasets.simulation.simulator import Simulator

FOV_DEG = 11.0              # that of the default sensor: more pixels see the same scene more finely
SKETCH_SIZE = 10
PPP, SBR, SEED = 10.0, 1.0, 1
PAPER_MS = {(141, 10): 7, (705, 10): 88, (282, 10): 18, (423, 10): 35, (564, 10): 60,       # on an RTX 3070 laptop,
            (141, 5): 6, (705, 5): 68, (282, 5): 12, (423, 5): 28, (564, 5): 55}            # by side and m
PROCESS = Path("/proc/self")


def timed(call: Callable[[], object], repeats: int) -> dict[str, float | None]:
    """Median, least and greatest time of `repeats` calls, ms, and by how many bytes the first made the process grow.

    A first call, which may allocate buffers for the others, only gives the memory.
    """
    growth_bytes, ms = peak_growth(call), []
    for _ in range(repeats):
        started = time.perf_counter()
        result = call()
        ms.append(1e3 * (time.perf_counter() - started))
        del result          # after the clock has stopped
    return {"median_ms": round(float(np.median(ms)), 2), "min_ms": round(min(ms), 2), "max_ms": round(max(ms), 2),
            "growth_bytes": growth_bytes}


def peak_growth(call: Callable[[], object]) -> int | None:
    """Bytes by which the memory of this process peaks in a call; None where Linux cannot reset the peak."""
    ctypes.CDLL(None).malloc_trim(0)        # return freed memory to the system, so that it counts when it is used again
    try:
        (PROCESS / "clear_refs").write_text("5")        # resets the peak, proc(5)
    except OSError:
        call()
        return None
    before = _status_bytes("VmRSS")
    call()
    return max(_status_bytes("VmHWM") - before, 0)


def sensor_of(side: int) -> SensorModel:
    """The default sensor with side × side pixels."""
    return default_sensor().replace(rows=side, cols=side, projection=Pinhole.from_fov(side, side, FOV_DEG))


def photons_of(sensor: SensorModel, ppp: float) -> PhotonEvents:
    """One frame of the simulated head: `ppp` photons per pixel with background, sorted by pixel."""
    return Simulator(sensor=sensor, sbr=SBR, ppp=ppp, seed=SEED).frame(0)[0]


def _status_bytes(name: str) -> int:
    """A size in bytes from /proc/self/status, such as VmRSS."""
    status = dict(line.split(":", 1) for line in (PROCESS / "status").read_text().splitlines())
    return int(status[name].split()[0]) * 1024
