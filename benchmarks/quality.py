"""Detections and depth errors of SRT3D on photon files that carry a reference.

    python benchmarks/quality.py FILE.npz … [--tolerance-bins 10] [--frequencies auto] [--surfaces 1]

Prints a row for each file: share of the reference pixels with a point within the tolerance (TD), points farther
off over the number of reference pixels (FD), mean absolute error of the matched ones (DAE).
"""

import argparse

from tqdm import tqdm

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.core.srt3d import SRT3D
from srt3d_ros.datasets import open_photons


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+")
    parser.add_argument("--tolerance-bins", type=float, default=10.0)
    parser.add_argument("--sketch-size", type=int)
    parser.add_argument("--frequencies", default="auto")
    parser.add_argument("--surfaces", type=int, default=1)
    args = parser.parse_args()
    rows = [row(file, args) for file in tqdm(args.files, unit="file")]
    print(f"| {'file':<34} | ppp | TD % | FD % | DAE bins | points |\n|---|---|---|---|---|---|")
    print("\n".join(rows))


def row(file: str, args: argparse.Namespace) -> str:
    """One file's line of the table."""
    photons = open_photons(file)
    sensor, frame = photons.sensor, photons.frame
    frequencies = choose(args.frequencies, sensor, args.sketch_size)
    cloud = SRT3D(sensor, frequencies, surfaces=args.surfaces)(sketch_photons(frame, sensor, frequencies))
    start = f"| {photons.name:<34} | {frame.photons / sensor.pixels:.3g} |"
    if photons.reference_depth_bins is None:
        return f"{start} – | – | – | {len(cloud)} |"
    found = evaluate(cloud, photons.reference_depth_bins, args.tolerance_bins, sensor.num_bins)
    return (f"{start} {100 * found.true_detections:.1f} | {100 * found.false_detections:.1f} | {found.dae_bins:.2f} | "
            f"{len(cloud)} |")


if __name__ == "__main__":
    main()
