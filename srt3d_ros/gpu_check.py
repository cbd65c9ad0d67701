"""`device: auto`: uses a GPU if its results agree with the CPU's, and it is faster."""

import logging
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import angular_frequencies, irf_spectrum
from srt3d_ros.core.sketching.sums import PhaseSums, noise_sketch
from srt3d_ros.kernels.devices import missing_for_cuda

LOG = logging.getLogger(__name__)
SHARE_ALIKE = 0.999             # of the pixels must have the same points
SIGMAS = 0.1                    # depths agree within so many standard deviations,
FLOAT32_STEPS = 2.0**-19        # or, as baselines have none, within this share of T
TRIED_PHOTONS = 40              # in each pixel of the frame that is tried, half of them signal


def device_for(device: str, sensor: SensorModel, frequencies: tuple[int, ...], build: Callable) -> tuple[str, str]:
    """The device to use, and why. "auto" tries a frame of this sensor on both, and logs if it refuses the GPU.

    `build` makes the reconstructor of the frames from the name of a device.
    """
    if device != "auto":
        return device, "asked for"
    if missing := missing_for_cuda():
        LOG.info(f"{missing}: computing on the CPU")
        return "cpu", missing
    frame = _frame(sensor, frequencies)
    try:
        (wanted, cpu_s), (found, gpu_s) = (_timed(build(device), frame) for device in ("cpu", "cuda"))
    except RuntimeError as error:                       # torch's: no memory, or no kernels for this GPU
        refused = str(error).partition("\n")[0]
    else:
        alike = share_alike(found, wanted, sensor.num_bins)
        refused = f"{100 * alike:.1f} % of its pixels are as on the CPU" if alike < SHARE_ALIKE else \
            f"{1e3 * gpu_s:.0f} ms a frame instead of {1e3 * cpu_s:.0f}" if gpu_s >= cpu_s else ""
    if refused:
        LOG.warning(f"the GPU is not used ({refused}): computing on the CPU")
    return ("cpu", refused) if refused else ("cuda", f"{1e3 * gpu_s:.0f} ms a frame, on the CPU {1e3 * cpu_s:.0f}")


def _frame(sensor: SensorModel, frequencies: tuple[int, ...]) -> PhaseSums:
    """A frame to try: slanted walls with a step, an even background, and photon noise."""
    noise, (row, col) = noise_sketch(sensor, frequencies), np.mgrid[:sensor.rows, :sensor.cols]
    depth = sensor.num_bins * (0.3 + 0.2 * col / sensor.cols + 0.2 * (2 * row > sensor.rows))
    phase = np.exp(1j * (depth + sensor.late)[..., None] * angular_frequencies(frequencies, sensor.num_bins))
    signal, spectrum = TRIED_PHOTONS / 2, np.resize(irf_spectrum(sensor, frequencies), phase.shape)     # repeated
    return replace(noise, sums=signal * spectrum * phase + signal**0.5 * noise.sums,
                   photons=np.full_like(noise.photons, TRIED_PHOTONS))


def _timed(reconstructor: Callable, frame: PhaseSums) -> tuple[PointCloud, float]:
    """The cloud of a frame and the seconds it takes, after a first run that compiles."""
    reconstructor(frame)
    reconstructor.forget()
    began = time.perf_counter()
    return reconstructor(frame), time.perf_counter() - began


def share_alike(found: PointCloud, wanted: PointCloud, num_bins: int) -> float:
    """The share of the pixels with the same points."""
    alike = np.ones(wanted.background.shape, bool)
    for k in range(max(found.surface.max(initial=0), wanted.surface.max(initial=0)) + 1):
        depth, expected = (cloud.image("depth_bins", k) for cloud in (found, wanted))
        most = np.fmax(SIGMAS * wanted.image("depth_std_bins", k), FLOAT32_STEPS * num_bins)
        near = np.abs(circular_difference(depth, expected, num_bins)) <= most
        alike &= near | (np.isnan(depth) & np.isnan(expected))
    return float(alike.mean())
