"""The same photons give the same cloud to the bit: for any number of threads, order, packets and form."""

import hashlib
import os
import subprocess
import sys
from dataclasses import fields

import numpy as np

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.photons import PhotonEvents, PhotonGates
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.core.sketching import Sketcher

SIDE, NUM_BINS, PPP, WARM_FRAMES = 141, 1_000, 8, 4
FORMS = ("sorted", "shuffled", "packets", "gates")
THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def make_sensor() -> SensorModel:
    """A sensor with all calibration that there is."""
    rng, shape = np.random.default_rng(1), (SIDE, SIDE)
    return SensorModel(SIDE, SIDE, NUM_BINS, 50e-12, np.exp(-np.linspace(-2, 4, 30)**2),
                       gain=rng.uniform(0.5, 1.5, shape), delay_bins=rng.uniform(-5, 5, shape),
                       mask=rng.random(shape) > 0.02, gates=GateWords(first_word=3, no_detection=0))


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


def make_packets(photons: PhotonEvents, sensor: SensorModel, form: str) -> list:
    if form == "gates":
        return [PhotonGates.from_events(photons, sensor)]
    order = np.arange(photons.photons) if form == "sorted" else np.random.default_rng(2).permutation(photons.photons)
    parts = np.array_split(order, 5 if form == "packets" else 1)
    return [PhotonEvents(photons.pixel[part], photons.toa[part]) for part in parts]


def digests(form: str = "sorted") -> list[str]:
    """Of every bit of a cold start's cloud, and of a warm start's last one."""
    sensor = make_sensor()
    frequencies = choose("auto", sensor)
    cold, warm = (Pooled(sensor, frequencies, surfaces=surfaces, warm_start=surfaces == 1, device="cpu")
                  for surfaces in (2, 1))
    found = []
    for seed in range(WARM_FRAMES):
        sketcher = Sketcher(sensor, frequencies)
        for packet in make_packets(make_photons(sensor, seed), sensor, form):
            sketcher.add(packet)
        sketch = sketcher.sketch()
        found += [cold(sketch)] if seed == 0 else []
        last = warm(sketch)
    return [digest(cloud) for cloud in (*found, last)]


def digest(cloud) -> str:
    values = [getattr(cloud, field.name) for field in fields(cloud)]
    return hashlib.sha256(b"".join(value.tobytes() if isinstance(value, np.ndarray) else str(value).encode()
                                   for value in values)).hexdigest()


def test_a_cloud_is_the_same_to_the_bit_in_processes_of_any_number_of_threads(repository):
    command = [sys.executable, "-c", "from tests.core import test_same_bits; print(*test_same_bits.digests())"]
    for threads in "12":
        done = subprocess.run(command, cwd=repository, env=os.environ | dict.fromkeys(THREADS, threads),
                              capture_output=True, text=True, check=True)
        assert done.stdout.split() == digests()


def test_order_packets_and_form_of_the_photons_change_no_bit_of_the_cloud():
    expected = digests()
    assert all(digests(form) == expected for form in FORMS[1:])
