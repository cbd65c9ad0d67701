"""The same photons give the same cloud to the bit, for any number of threads."""

import hashlib
import os
import subprocess
import sys
from dataclasses import fields

import numpy as np

from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from tests.core.scenes import make_sensor, ramp, simulate

SIDE = 141
THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def digests() -> list[str]:
    """Of every bit of the clouds of two frames of a step, a slope and a half window before it."""
    rng, shape = np.random.default_rng(1), (SIDE, SIDE)
    sensor = make_sensor(*shape, gain=rng.uniform(0.5, 1.5, shape), delay_bins=rng.uniform(-5, 5, shape),
                         mask=rng.random(shape) > 0.02)
    near, far = ramp(*shape, 100, 0, 0), ramp(*shape, 300, 0.7, 1.2)
    depth = np.stack([np.where(far < 400, near, far), np.where(far < 500, np.nan, 150)])
    frequencies = choose_frequencies("auto", sensor)
    pooled = Pooled(sensor, frequencies, surfaces=2, device="cpu")
    sketches = (sketch_photons(simulate(depth, 2, 8, sensor, seed), sensor, frequencies) for seed in range(2))
    return [digest(pooled(sketch)) for sketch in sketches]


def digest(cloud) -> str:
    values = [getattr(cloud, field.name) for field in fields(cloud)]
    return hashlib.sha256(b"".join(value.tobytes() if isinstance(value, np.ndarray) else str(value).encode()
                                   for value in values)).hexdigest()


def test_a_cloud_is_the_same_to_the_bit_in_processes_of_any_number_of_threads(repository):
    command = [sys.executable, "-c", "from tests.core import test_same_bits; print(*test_same_bits.digests())"]
    one, three = (subprocess.run(command, cwd=repository, env=os.environ | dict.fromkeys(THREADS, threads),
                                 capture_output=True, text=True, check=True).stdout for threads in "13")
    assert one == three and len(one.split()) == 2


STEP = """
import hashlib
from tests.kernels.frames import CPU, GATE, make_frame, make_state, make_terms, padded
frame = make_frame((24, 40), 0)
state = make_state(frame, 1, 0)
found = CPU.pooled_step(padded(frame), state, make_terms(frame, state), 4.5, 7, 1, GATE)
print(hashlib.sha256(found.tobytes()).hexdigest())
"""


def test_a_kernel_gives_the_same_bits_compiled_and_read_from_the_disk(repository, tmp_path):
    compiled, read = (subprocess.run([sys.executable, "-c", STEP], cwd=repository, check=True, capture_output=True,
                                     text=True, env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}).stdout
                      for _ in range(2))
    assert list(tmp_path.rglob("*.nbc")) and compiled == read
