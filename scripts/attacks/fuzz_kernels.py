"""The CPU kernels with bounds checks on, over the photons and gates that fuzzing found readable, and odd shapes.

    .venv/bin/python scripts/attacks/fuzz_kernels.py

numba compiles anew with NUMBA_BOUNDSCHECK=1, into a cache of its own: minutes, once. An index outside its array is an
IndexError then, not the neighbour's number. Exit code 0 if there is none, 1 if there is.
"""

import argparse
import os
import sys
from pathlib import Path

OUT = Path("build/attacks")
# Before numba is imported.
os.environ["NUMBA_BOUNDSCHECK"] = "1"
os.environ["NUMBA_CACHE_DIR"] = str((OUT / "numba_boundscheck").absolute())

import numpy as np  # noqa: E402
from fuzz_messages import golden_sensor  # noqa: E402
from result import write_result  # noqa: E402
from tqdm import tqdm  # noqa: E402

from srt3d_ros.core.frequencies import DEFAULT_SKETCH_SIZE, choose  # noqa: E402
from srt3d_ros.core.methods import METHODS  # noqa: E402
from srt3d_ros.core.photons import PhotonEvents  # noqa: E402
from srt3d_ros.core.sensor import SensorModel  # noqa: E402
from srt3d_ros.core.sketching import sketch_photons  # noqa: E402
from srt3d_ros.errors import InvalidInput  # noqa: E402
from srt3d_ros.messages import gates, photons  # noqa: E402

SHAPES = ((1, 1), (1, 7), (7, 1), (2, 2), (3, 4), (5, 33), (33, 5), (17, 16))
PPP = (0, 0.1, 1, 20)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", type=Path, default=OUT / "fuzz", help="of fuzz.py; default: %(default)s")
    parser.add_argument("--surfaces", type=int, nargs="+", default=[1, 2], metavar="K", help="default: 1 2")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=OUT / "fuzz_kernels.json", help="default: %(default)s")
    args = parser.parse_args()
    frames = [*of_corpus(args.corpus), *odd(args.seed)]
    failures, done = [], 0
    for name, sensor, frame in tqdm(frames, unit="frame", delay=2):
        for surfaces in args.surfaces:
            try:
                frequencies = choose("auto", sensor, min(DEFAULT_SKETCH_SIZE, max((sensor.num_bins - 1) // 2, 1)))
                method = METHODS["pooled"].build(sensor, frequencies, surfaces=surfaces, device="cpu")
                method(sketch_photons(frame, sensor, frequencies))
                done += 1
            except InvalidInput:
                continue
            except Exception as error:
                failures.append(f"{name}, {surfaces} surfaces: {type(error).__name__}: {error}")
    write_result(args.out, {"seed": args.seed, "frames": len(frames), "surfaces": args.surfaces,
                            "reconstructions": done, "failures": failures})
    for line in failures[:10]:
        print(line)
    print(f"{done} reconstructions of {len(frames)} frames with bounds checks: "
          f"{'FAIL' if failures else 'hold'}; {args.out}")
    return bool(failures)


def of_corpus(corpus: Path):
    """Name, sensor and frame of each readable input."""
    sensor = golden_sensor()
    for door, codec in (("photons", photons), ("gates", gates)):
        for path in sorted((corpus / door / "corpus").glob("*")):
            try:
                yield f"{door} {path.name[:8]}", sensor, codec.decode_cdr(path.read_bytes(), sensor)[1]
            except InvalidInput:
                continue


def odd(seed: int):
    """Shapes that kernels split badly, T and IRFs at their limits, from no photons to many."""
    random = np.random.default_rng(seed)
    for rows, cols in SHAPES:
        for num_bins, length in ((2, 1), (3, 3), (97, 5), (4613, 41)):
            sensor = SensorModel(rows, cols, num_bins, 1e-10, np.hanning(length + 2)[1:-1])
            for ppp in PPP:
                count = int(ppp * rows * cols)
                pixel = np.sort(random.integers(0, rows * cols, count)).astype(np.uint32)
                toa = random.integers(0, num_bins, count).astype(np.uint16)
                toa[:count // 2] = num_bins - 1
                yield f"{rows}×{cols}, T = {num_bins}, {count} photons", sensor, PhotonEvents(pixel, toa)


if __name__ == "__main__":
    sys.exit(main())
