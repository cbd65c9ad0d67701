"""The same photons give the same cloud to the bit, for any number of threads."""

import hashlib
import os
import subprocess
import sys
from dataclasses import fields

import numpy as np

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketching import sketch_photons

SIDE, NUM_BINS, PPP = 141, 1_000, 8
THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def make_sensor() -> SensorModel:
    """A sensor with all calibration that there is."""
    rng, shape = np.random.default_rng(1), (SIDE, SIDE)
    return SensorModel(SIDE, SIDE, NUM_BINS, 50e-12, np.exp(-np.linspace(-2, 4, 30)**2),
                       gain=rng.uniform(0.5, 1.5, shape), delay_bins=rng.uniform(-5, 5, shape),
                       mask=rng.random(shape) > 0.02)


def make_photons(sensor: SensorModel, seed: int) -> PhotonEvents:
    """A step, a slope across the end of the period, half a window before it, and background; sorted by pixel."""
    rng = np.random.default_rng([seed, 7])
    row, col = np.divmod(rng.integers(0, sensor.pixels, PPP * sensor.pixels), sensor.cols)
    depth = np.where(col < sensor.cols // 2, 200, sensor.num_bins - 60 + 0.7 * row) + seed
    depth = np.where((col > 3 * sensor.cols // 4) & (rng.random(len(col)) < 0.5), 500, depth)
    late = sensor.delay_bins[row, col] + rng.normal(0, 4, len(row))
    toa = np.where(rng.random(len(row)) < 0.6, depth + late, rng.uniform(0, sensor.num_bins, len(row)))
    order = np.argsort(row * sensor.cols + col, kind="stable")
    pixel = (row * sensor.cols + col)[order].astype(np.uint32)
    return PhotonEvents(pixel, (np.floor(toa[order]) % sensor.num_bins).astype(np.uint16))


def digests() -> list[str]:
    """Of every bit of the clouds of a cold and of a warm start."""
    sensor = make_sensor()
    frequencies = choose("auto", sensor)
    pooled = Pooled(sensor, frequencies, surfaces=2, warm_start=True, device="cpu")
    return [digest(pooled(sketch_photons(make_photons(sensor, seed), sensor, frequencies))) for seed in range(2)]


def digest(cloud) -> str:
    values = [getattr(cloud, field.name) for field in fields(cloud)]
    return hashlib.sha256(b"".join(value.tobytes() if isinstance(value, np.ndarray) else str(value).encode()
                                   for value in values)).hexdigest()


def test_a_cloud_is_the_same_to_the_bit_in_processes_of_any_number_of_threads(repository):
    command = [sys.executable, "-c", "from tests.core import test_same_bits; print(*test_same_bits.digests())"]
    one, three = (subprocess.run(command, cwd=repository, env=os.environ | dict.fromkeys(THREADS, threads),
                                 capture_output=True, text=True, check=True).stdout for threads in "13")
    assert one == three and len(one.split()) == 2
