"""The same photons, the same cloud to the bit: whatever the number of threads, the compiler's work, the photons' order.

A frame of 141 × 141 pixels is reconstructed by every method, in child processes that differ in their threads (numba,
OpenMP and torch); with kernels compiled afresh, for this processor and for one of 2013, and read from the cache; a
sequence of frames by a warm start too. For the methods on sketches the photons also come shuffled, in packets and as
gates. Every cloud must be the same to the bit.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import fields
from functools import partial
from pathlib import Path

import numpy as np
from result import write_result
from tqdm import tqdm

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.methods import METHODS, SKETCH_METHODS
from srt3d_ros.core.photons import PhotonEvents, PhotonFrame, PhotonGates
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.core.sketching import Sketcher

OUT = Path("build/attacks/same_bits.json")
THREADS = 1, 2, 4, 8
SIDE, NUM_BINS, PPP, WARM_FRAMES = 141, 1_000, 8, 4
PROCESSORS = {"this processor": {}, "a Haswell of 2013": {"NUMBA_CPU_NAME": "haswell",
                                                         "NUMBA_CPU_FEATURES": "+sse2,+avx,+avx2,+bmi,+bmi2,+fma"}}
FORMS = "sorted", "shuffled", "packets", "gates"


def make_sensor() -> SensorModel:
    """A sensor with all calibration that there is."""
    rng, shape = np.random.default_rng(1), (SIDE, SIDE)
    return SensorModel(SIDE, SIDE, NUM_BINS, 50e-12, np.exp(-np.linspace(-2, 4, 30)**2),
                       gain=rng.uniform(0.5, 1.5, shape), delay_bins=rng.uniform(-5, 5, shape),
                       mask=rng.random(shape) > 0.02, gates=GateWords(first_word=3, no_detection=0))


def make_photons(sensor: SensorModel, seed: int) -> PhotonEvents:
    """A step, a slope across the end of the period, half a window before it, and background."""
    rng = np.random.default_rng([seed, 7])
    row, col = np.divmod(rng.integers(0, sensor.pixels, PPP * sensor.pixels), sensor.cols)
    depth = np.where(col < sensor.cols // 2, 200, sensor.num_bins - 60 + 0.7 * row) + seed
    depth = np.where((col > 3 * sensor.cols // 4) & (rng.random(len(col)) < 0.5), 500, depth)
    late = sensor.delay_bins[row, col] + rng.normal(0, 4, len(row))
    toa = np.where(rng.random(len(row)) < 0.6, depth + late, rng.uniform(0, sensor.num_bins, len(row)))
    order = np.argsort(row * sensor.cols + col, kind="stable")
    pixel = (row * sensor.cols + col)[order].astype(np.uint32)
    return PhotonEvents(pixel, (np.floor(toa[order]) % sensor.num_bins).astype(np.uint16))


def packets(photons: PhotonEvents, sensor: SensorModel, form: str) -> list[PhotonFrame]:
    """The same photons, as they may come over the wire."""
    if form == "gates":
        return [PhotonGates.from_events(photons, sensor)]
    order = np.arange(photons.photons) if form == "sorted" else np.random.default_rng(2).permutation(photons.photons)
    parts = np.array_split(order, 5 if form == "packets" else 1)
    return [PhotonEvents(photons.pixel[part], photons.toa[part]) for part in parts]


def clouds(form: str = "sorted", methods=tuple(METHODS)) -> dict[str, str]:
    """A digest of the cloud of every method, and of the last one of a warm start's sequence."""
    sensor, found = make_sensor(), {}
    for name in methods:
        method = METHODS[name]
        frequencies = choose(method.frequencies, sensor)
        reconstruct = method.build(sensor, frequencies, surfaces=2, device="cpu")
        if method.needs == "sketch":
            found[name] = digest(reconstruct(sketch(sensor, frequencies, 0, form)))
        else:
            found[name] = digest(reconstruct(packets(make_photons(sensor, 0), sensor, form)[0]))
    if "pooled" in methods:
        frequencies = choose("auto", sensor)
        warm = Pooled(sensor, frequencies, warm_start=True, device="cpu")
        found["pooled, warm start"] = [digest(warm(sketch(sensor, frequencies, seed, form)))
                                      for seed in range(WARM_FRAMES)][-1]
    return found


def sketch(sensor: SensorModel, frequencies, seed: int, form: str):
    """The sketch of a frame whose photons come in this form."""
    sketcher = Sketcher(sensor, frequencies)
    for packet in packets(make_photons(sensor, seed), sensor, form):
        sketcher.add(packet)
    return sketcher.sketch()


def digest(cloud: PointCloud) -> str:
    """Of every bit of a cloud."""
    every = hashlib.sha256(str(len(cloud)).encode())
    for field in fields(cloud):
        value = getattr(cloud, field.name)
        every.update(value.tobytes() if isinstance(value, np.ndarray) else str(value).encode())
    return every.hexdigest()[:16]


def in_child(threads: int, methods=tuple(METHODS), **variables: str) -> dict[str, str]:
    """`clouds` of a process with so many threads, and these variables in its environment."""
    names = "NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"
    run = subprocess.run([sys.executable, __file__, "--child", *methods], capture_output=True, text=True, check=True,
                         env=os.environ | dict.fromkeys(names, str(threads)) | variables)
    return json.loads(run.stdout.splitlines()[-1])


def compiled_for(processor: dict[str, str]) -> dict[str, str]:
    """`clouds` of a process that compiles all kernels itself."""
    with tempfile.TemporaryDirectory() as empty:
        return in_child(2, NUMBA_CACHE_DIR=empty, **processor)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--times", type=int, default=2, help="processes of each number of threads")
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--child", nargs="+", choices=list(METHODS), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        print(json.dumps(clouds(methods=arguments.child)))
        return 0
    rounds = {f"{threads} threads, run {time + 1}": partial(in_child, threads)
              for time in range(arguments.times) for threads in THREADS}
    rounds |= {form: partial(clouds, form, SKETCH_METHODS) for form in FORMS[1:]}
    rounds |= {f"compiled for {name}": partial(compiled_for, variables) for name, variables in PROCESSORS.items()}
    first, compared, wrong = clouds(), 0, []
    for name, make in tqdm(rounds.items()):
        found = make()
        compared += len(found)
        wrong += [f"{method}: {name}" for method in found if found[method] != first[method]]
    write_result(arguments.out, {"seed": 0, "size": f"{SIDE} × {SIDE}", "rounds": list(rounds), "methods": list(first),
                                 "compared": compared, "different": wrong})
    print("\n".join([*wrong, f"{compared} clouds of {len(first)} methods, in {len(rounds)} rounds "
                     f"({', '.join(rounds)}): {len(wrong)} differ"]))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
