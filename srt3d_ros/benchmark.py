"""Time, memory and rates of this machine, on one screen; benchmarks/ times what the SRT3D paper does."""

import ctypes
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.methods import DEFAULT_METHOD, METHODS
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.core.sketching.frequencies import choose
from srt3d_ros.core.sketching.photons import PhotonEvents, PhotonFrame, PhotonGates, PhotonHistograms
from srt3d_ros.core.sketching.sketcher import Sketcher, sketch_photons
from srt3d_ros.datasets.simulation.scene import default_sensor
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.evaluation.results import aligned
from srt3d_ros.evaluation.scenes import net_sensor
from srt3d_ros.versions import machine

SIDES, SKETCH_SIZES = (141, 282, 705), (5, 10)
FOV_DEG = 11.0              # of the default sensor: finer pixels, not more of the scene
PPP, SBR, SEED = 10.0, 1.0, 1       # the time of a frame depends on neither (Figure 1 of the paper)
SKETCHED_PPP = 100.0        # photons per pixel: enough for the rate not to depend on them
CYCLES = 15_040             # laser cycles in a frame of gates: a tenth of a second of the RT3D paper's 32 × 32 array
REPEATS = 5
PROCESS = Path("/proc/self")
FORGET_PEAK = "5"           # written to clear_refs, proc(5)


class Timing(NamedTuple):
    """Milliseconds of each of some runs, and by how many bytes the process grew in the first; None if not known."""

    ms: list[float]
    growth_bytes: int | None

    @property
    def median_ms(self) -> float:
        return float(np.median(self.ms))


def screen(device: str) -> Iterator[str]:
    """Lines of the report, each as soon as it is measured; `device` is "cpu" or "cuda"."""
    facts = machine(device)
    gpu = f"{facts['gpu']}, " if "gpu" in facts else ""
    yield f"{gpu}{facts['cpus']} × {facts['machine']}, load {facts['load_1min']}, {facts['date']}\n"
    yield f"Reconstruction by {DEFAULT_METHOD}: the simulated head, {PPP:g} photons per pixel, SBR {SBR:g}, T = " \
          f"{default_sensor().num_bins}"
    yield aligned([["pixels", "m", "ms, median", "frames/s", "memory, MB"], *(
        reconstruction_row(side, m, device) for side in SIDES for m in SKETCH_SIZES)]) + "\n"
    yield f"Sketching, m = {SKETCH_SIZES[-1]}, {SKETCHED_PPP:g} photons per pixel"
    yield aligned([["photons", "pixels", "ms, median", "photons/s"], *(
        sketching_row(form, sensor, frame) for form, (sensor, frame) in sketched_frames().items())])


def device_for(device: str) -> str:
    """"cpu" or "cuda", of "auto" that which takes frames of the first size."""
    sensor, method = sensor_of(SIDES[0]), METHODS[DEFAULT_METHOD]
    return method.build(sensor, choose(method.frequencies, sensor, SKETCH_SIZES[0]), device=device).device


def reconstruction_row(side: int, m: int, device: str) -> list[str]:
    """Cells of one size: from a sketch in memory to a cloud in memory."""
    sensor, method = sensor_of(side), METHODS[DEFAULT_METHOD]
    frequencies = choose(method.frequencies, sensor, m)
    sketch = sketch_photons(photons_of(sensor, PPP), sensor, frequencies)
    reconstructor = method.build(sensor, frequencies, device=device)
    reconstructor.warm_up()
    timing = timed(lambda: reconstructor(sketch))
    memory = "–" if timing.growth_bytes is None else f"{timing.growth_bytes / 1e6:.0f}"
    return [f"{side}²", str(m), f"{timing.median_ms:.3g}", f"{1e3 / timing.median_ms:.3g}", memory]


def sketched_frames() -> dict[str, tuple[SensorModel, PhotonFrame]]:
    """Sensor and frame of each form in which photons come."""
    sensor, array = sensor_of(SIDES[0]), net_sensor().replace(gates=GateWords())
    events = photons_of(sensor, SKETCHED_PPP)
    order = np.random.default_rng(SEED).permutation(events.photons)
    in_bins = Simulator(sensor=array, sbr=SBR, ppp=SKETCHED_PPP, seed=SEED).frame(0)[0]
    counts = np.bincount(in_bins.pixel.astype(np.int64) * array.num_bins + in_bins.toa,
                         minlength=array.pixels * array.num_bins)
    histograms = PhotonHistograms(counts.reshape(array.rows, array.cols, -1).astype(np.uint16))
    return {"sorted by pixel": (sensor, events),
            "in any order": (sensor, PhotonEvents(events.pixel[order], events.toa[order])),
            "gates": (array, gates_of(array, SKETCHED_PPP, CYCLES)), "histograms": (array, histograms)}


def sketching_row(form: str, sensor: SensorModel, frame: PhotonFrame) -> list[str]:
    """Cells of one form: a frame that has just arrived, checks included."""
    sketcher = Sketcher(sensor, choose("auto", sensor, SKETCH_SIZES[-1]))
    sketcher.add(frame)         # compiles
    photons = int(sketcher.sketch().photons.sum())
    timing = timed(lambda: sketcher.add(frame))
    rate = 1e3 * photons / timing.median_ms
    return [form, f"{sensor.rows} × {sensor.cols}", f"{timing.median_ms:.3g}", f"{rate:.2g}"]


def timed(call: Callable[[], object], repeats: int = REPEATS) -> Timing:
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
        (PROCESS / "clear_refs").write_text(FORGET_PEAK)
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


def gates_of(sensor: SensorModel, ppp: float, cycles: int) -> PhotonGates:
    """Cycles of an array, `ppp` photons per pixel in all of them together, each in any cycle; of two in one, one."""
    random = np.random.default_rng(SEED)
    words = np.full((cycles, sensor.pixels), sensor.gates.no_detection, np.uint16)
    pixel = np.repeat(np.arange(sensor.pixels), random.poisson(ppp, sensor.pixels))
    words[random.integers(0, cycles, len(pixel)), pixel] = random.integers(0, sensor.num_bins, len(pixel))
    return PhotonGates(words.reshape(cycles, sensor.rows, sensor.cols))


def _status_bytes(name: str) -> int:
    """A size in the status of this process, such as VmRSS, bytes."""
    status = dict(line.split(":", 1) for line in (PROCESS / "status").read_text().splitlines())
    return int(status[name].split()[0]) * 1024
