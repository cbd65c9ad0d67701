"""Shared by the benchmarks: frames of the simulated head, times and memory of calls, and mean scores."""

import ctypes
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.metrics import Metrics
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets.simulation.scene import default_sensor
from srt3d_ros.datasets.simulation.simulator import Simulator

FOV_DEG = 11.0              # that of the default sensor: more pixels see the same scene more finely
SIDE, SKETCH_SIZE = 141, 10
PPPS = (1, 3, 10, 30, 100, 300, 1000)
PPP, SBR, SEED = 10.0, 1.0, 1       # the time of a frame depends on neither PPP nor SBR (Figure 1 of the paper)
PROCESS = Path("/proc/self")


class Timing(NamedTuple):
    """Milliseconds of each run, and by how many bytes the first run made the process grow (None: unknown)."""

    ms: list[float]
    growth_bytes: int | None

    @property
    def median_ms(self) -> float:
        return float(np.median(self.ms))


def timed(call: Callable[[], object], repeats: int) -> Timing:
    """Time `repeats` calls. A first call, which may allocate buffers for the others, only gives the memory."""
    growth_bytes, ms = peak_growth(call), []
    for _ in range(repeats):
        started = time.perf_counter()
        result = call()
        ms.append(1e3 * (time.perf_counter() - started))
        del result          # after the clock has stopped
    return Timing(ms, growth_bytes)


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


def mean_scores(found: Sequence[Metrics]) -> dict[str, float]:
    """Mean true and false detections, %, and depth error, bins, of several clouds."""
    td, fd, dae = np.mean([(one.true_detections, one.false_detections, one.dae_bins) for one in found], axis=0)
    return {"td_percent": round(100 * td, 2), "fd_percent": round(100 * fd, 2), "dae_bins": round(dae, 3)}


def _status_bytes(name: str) -> int:
    """A size in bytes from /proc/self/status, such as VmRSS."""
    status = dict(line.split(":", 1) for line in (PROCESS / "status").read_text().splitlines())
    return int(status[name].split()[0]) * 1024
