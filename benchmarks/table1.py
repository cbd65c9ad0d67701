"""Time and memory of a frame on the CPU, by image and sketch size: Table 1 of the SRT3D paper; and of an FFT."""

import argparse
from collections.abc import Iterator
from functools import partial

from benchmarks.frames import PPP, fft, photons_of, sensor_of, timed
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies

PAPER_MS = {(141, 10): 7, (705, 10): 88, (282, 10): 18, (423, 10): 35, (564, 10): 60,       # RTX 3070 laptop
            (141, 5): 6, (705, 5): 68, (282, 5): 12, (423, 5): 28, (564, 5): 55}


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--repeats", type=int, default=5, help="timed runs of each method (%(default)d)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each image size, sketch size and method."""
    for side, m in PAPER_MS:
        sensor = sensor_of(side)
        photons = photons_of(sensor, PPP)
        for name in ("pooled", "srt3d"):
            frequencies = choose_frequencies(METHODS[name].frequencies, sensor, m)
            sketch = sketch_photons(photons, sensor, frequencies)
            reconstructor = METHODS[name].build(sensor, frequencies, device="cpu")
            reconstructor.warm_up()         # allocates what would otherwise count as the frame's memory
            timing = timed(partial(reconstructor, sketch), args.repeats)
            del reconstructor               # its memory would count as the next frame's
            yield {"pixels": f"{side}x{side}", "m": m, "method": name, "paper_ms": PAPER_MS[side, m],
                   **timing.summary(), "growth_bytes": timing.growth_bytes}
        yield {"pixels": f"{side}x{side}", "method": "fft", **timed(fft(sensor), args.repeats).summary()}
