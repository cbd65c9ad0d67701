"""What the benchmarks have in common: frames of the simulated head, and how calls are timed."""

import ctypes
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets.simulation.scene import default_sensor
from srt3d_ros.datasets.simulation.simulator import Simulator

FOV_DEG = 11.0              # of the default sensor: finer pixels, not more of the scene
SIDE, SKETCH_SIZE = 141, 10
PPPS = (1, 3, 10, 30, 100, 300, 1000)
PPP, SBR, SEED = 10.0, 1.0, 1       # the time of a frame depends on neither (Figure 1 of the paper)
PROCESS = Path("/proc/self")


class Timing(NamedTuple):
    """Milliseconds of each of some runs, and by how many bytes the process grew in the first; None if not known."""

    ms: list[float]
    growth_bytes: int | None

    @property
    def median_ms(self) -> float:
        return float(np.median(self.ms))


def timed(call: Callable[[], object], repeats: int) -> Timing:
    """Times of a call after a first one, which may allocate what later ones use and whose memory is measured."""
    growth_bytes, ms = peak_growth(call), []
    for _ in range(repeats):
        started = time.perf_counter()
        result = call()
        ms.append(1e3 * (time.perf_counter() - started))
        del result          # not within the time
    return Timing(ms, growth_bytes)


def peak_growth(call: Callable[[], object]) -> int | None:
    """Bytes by which this process grew during a call; None where the system does not forget an earlier peak."""
    ctypes.CDLL(None).malloc_trim(0)        # freed memory goes back to the system, so that it counts when used again
    try:
        (PROCESS / "clear_refs").write_text("5")        # forgets the peak, proc(5)
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
    """One frame of the simulated head at `ppp` photons per pixel, signal and background alike, sorted by pixel."""
    return Simulator(sensor=sensor, sbr=SBR, ppp=ppp, seed=SEED).frame(0)[0]


def _status_bytes(name: str) -> int:
    """A size in the status of this process, such as VmRSS, bytes."""
    status = dict(line.split(":", 1) for line in (PROCESS / "status").read_text().splitlines())
    return int(status[name].split()[0]) * 1024
