"""How often `pooled` shows a point where there is only background, against its `false_alarm_rate`.

    python -m benchmarks false_alarms           # five minutes on two cores

Frames of background are reconstructed until PATCHES patches of false points have appeared. `share` is the share of
pixels with a point; `over_rate` is `share` over the `false_alarm_rate` that was set; `blobs_percent` of the frames have
a patch of more than BLOB points: false points come together, so a share alone says little.
"""

import argparse
from collections.abc import Iterator
from itertools import product

import numpy as np
from scipy.ndimage import label
from tqdm import tqdm

from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets import irf

SKETCH_SIZE = 10
# T, and the width of a bin (s); the IRF is 0.3 ns wide.
PERIODS = {586: 16e-12, 1024: 50e-12, 4613: 16e-12}
PATCHES = 30            # end of a measurement, or after --frames
BLOB = 30               # points


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--rates", type=float, nargs="+", default=[1e-2, 1e-3], help="false_alarm_rate")
    parser.add_argument("--ppp", type=float, nargs="+", default=[0.2, 1, 10, 100], help="photons per pixel")
    parser.add_argument("--side", type=int, default=141, help="rows and columns (%(default)s)")
    parser.add_argument("--frames", type=int, default=400, help="most frames of a measurement (%(default)s)")
    parser.add_argument("--surfaces", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--periods", type=int, nargs="+", default=list(PERIODS), help="T, bins")


def run(args: argparse.Namespace) -> Iterator[dict]:
    pixels = args.side**2
    for num_bins, ppp, surfaces, rate in tqdm(list(product(args.periods, args.ppp, args.surfaces, args.rates))):
        width_s = PERIODS[num_bins]
        response = irf.spad(width_s, fwhm_s=300e-12, tail_s=100e-12)
        sensor = SensorModel(args.side, args.side, num_bins, width_s, response)
        frequencies = choose_frequencies("auto", sensor, SKETCH_SIZE)
        pooled = Pooled(sensor, frequencies, surfaces, rate, background="flat")
        rng, points, patches, blobs, frames = np.random.default_rng(0), 0, 0, 0, 0
        while patches < PATCHES and frames < args.frames:
            pixel = np.repeat(np.arange(pixels, dtype=np.uint32), rng.poisson(ppp, pixels))
            toa = rng.integers(0, num_bins, len(pixel)).astype(np.uint16)
            cloud = pooled(sketch_photons(PhotonEvents(pixel, toa), sensor, frequencies))
            shown = np.isfinite(cloud.image("depth_bins"))
            patch, number = label(shown, np.ones((3, 3)))
            points, patches, frames = points + int(shown.sum()), patches + number, frames + 1
            blobs += int((np.bincount(patch.ravel())[1:] > BLOB).any())
        share = points / (frames * pixels)
        yield {"num_bins": num_bins, "ppp": ppp, "surfaces": surfaces, "side": args.side, "false_alarm_rate": rate,
               "frames": frames, "patches": patches, "blobs_percent": round(100 * blobs / frames, 2),
               "share": float(f"{share:.3g}"), "over_rate": round(share / rate, 2)}
