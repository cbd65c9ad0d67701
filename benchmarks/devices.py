"""Ranges of devices' logs against what is known of them: docs/devices.md has the figures.

A log of a TMF8820 before a plane that a robot arm moves: the centre zone, after an affine fit (distance = a · range +
b) on every other capture, on the others; then the halves change places. A log of a TMF8829: against its own results.
"""

import argparse
import gzip
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from srt3d_ros.core.frequency_design import highest_passed
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch_design import design_for
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.devices import tmf882x, tmf8829
from srt3d_ros.devices.reading import Reading

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "histograms"
CENTRE = 4
SURE = 20           # SNR of the results that count


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the two logs (%(default)s)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    yield from tmf882x_errors(args.data / "tmf8820_plane_distances.json")
    yield from tmf882x_errors(args.data / "tmf8820_plane_distances.json", designed=True)
    yield tmf8829_errors(args.data / "tmf8829_log.json.gz")


def passed(sensor: SensorModel) -> tuple[int, ...]:
    """All frequencies that the IRF passes: with 10⁵ photons a zone, depths err by the pulse's shape, not by chance."""
    return tuple(range(1, highest_passed(sensor) + 1))


def found_mm(reading: Reading, frequencies: tuple[int, ...]) -> np.ndarray:
    """Ranges of the zones [rows, cols], NaN where there is no surface."""
    sensor, frame, _ = reading
    cloud = Pooled(sensor, frequencies, device="cpu")(sketch_photons(frame, sensor, frequencies))
    ranges = np.full((sensor.rows, sensor.cols), np.nan)
    ranges[cloud.row, cloud.col] = sensor.range_m(cloud.depth_bins) * 1e3
    return ranges


def centre_mm(reading: Reading, frequencies: tuple[int, ...]) -> float:
    return float(found_mm(reading, frequencies)[1, 1])


def tmf882x_errors(path: Path, designed: bool = False) -> Iterator[dict]:
    """For either half of the captures: [median, 95 %, greatest] |error|, of all, and of those that the device ranges.

    Args:
        designed: with the ten frequencies of the design, not all that the IRF passes.
    """
    captures = json.loads(path.read_text())
    truth = np.array([capture["dist_to_plane"] for capture in captures]) * 1e3
    ranged, vendor = (np.array([capture["distances"][0][key][CENTRE] for capture in captures], float)
                      for key in ("confs_1", "depths_1"))
    readings = list(tmf882x.read(path))
    chosen = [design_for(one.frame, one.sensor).frequencies if designed else passed(one.sensor) for one in readings]
    found = np.array([centre_mm(one, frequencies) for one, frequencies in zip(readings, chosen)])
    everything, valid = np.arange(len(truth)), np.flatnonzero(ranged > 0)
    for half in (0, 1):
        yield {"log": path.name, "frequencies": "designed" if designed else "passed", "half": half,
               "errors_mm": _errors(found, truth, everything, half),
               "valid_errors_mm": _errors(found, truth, valid, half),
               "vendor_mm": _errors(vendor, truth, everything, half),
               "vendor_valid_mm": _errors(vendor, truth, valid, half)}


def _errors(found: np.ndarray, truth: np.ndarray, captures: np.ndarray, half: int) -> list[float]:
    fitted, tested = captures[half::2], captures[1 - half::2]
    slope, zero = np.polyfit(found[fitted], truth[fitted], 1)
    off = np.abs(slope * found[tested] + zero - truth[tested])
    return [round(float(value), 2) for value in (np.median(off), np.percentile(off, 95), off.max())]


def tmf8829_errors(path: Path) -> dict:
    """Ranges less the log's own results where those are sure, in row 0, whose histograms the log has."""
    with gzip.open(path) as stream:
        results = [frame["results"][0] for frame in json.load(stream)["Result_Set"]]
    own, snr = (np.array([[zone["peaks"][0][key] for zone in row] for row in results], float)
                for key in ("distance", "snr"))
    found = np.concatenate([found_mm(one, design_for(one.frame, one.sensor).frequencies)
                            for one in tmf8829.read(path)])
    off = (found - own)[snr >= SURE]
    return {"log": path.name, "zones": off.size, "missing": int(np.isnan(off).sum()),
            "median_mm": round(float(np.nanmedian(off)), 1), "median_abs_mm": round(float(np.nanmedian(abs(off))), 1),
            "p90_abs_mm": round(float(np.nanpercentile(abs(off), 90)), 1)}
