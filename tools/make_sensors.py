"""Writes config/sensors/*.json, descriptions to begin one's own from: `python tools/make_sensors.py [FOLDER]`."""

import json
import sys
import textwrap
from pathlib import Path

import numpy as np

from srt3d_ros.core.distortion import PlumbBob
from srt3d_ros.core.projection import AngularScan, Pinhole
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.datasets.irf import spad
from srt3d_ros.messages import sensor as sensor_message

FOLDER = Path(__file__).resolve().parents[1] / "config" / "sensors"
PEAK = 10_000               # of the impulse responses, which are written as a histogram of so many counts would be


def sensors() -> dict[str, tuple[SensorModel, str]]:
    """Each sensor with what is to be said about it."""
    gated = SensorModel(
        rows=32, cols=32, num_bins=153, bin_width_s=250e-12, irf=spad(250e-12, 500e-12, 300e-12, 0.2),
        toa_offset_bins=213, projection=Pinhole(183.0, 183.0, 15.5, 15.5), gates=GateWords(0, 65_535),
        frame_id="spad_optical")
    scanner = SensorModel(
        rows=141, cols=141, num_bins=4613, bin_width_s=2e-12, irf=spad(2e-12, 55e-12, 100e-12, 0.3),
        toa_offset_bins=5000, projection=AngularScan(0.0952, -0.00136, 0.0952, -0.00136), frame_id="lidar")
    array = SensorModel(
        rows=512, cols=512, num_bins=1024, bin_width_s=50e-12, irf=spad(50e-12, 200e-12, 150e-12, 0.2),
        projection=Pinhole(1450.0, 1450.0, 255.5, 255.5, PlumbBob(-0.12, 0.08, 0.0005, -0.0003, 0.0)),
        frame_id="spad_optical")
    return {
        "spad_32x32_gates": (
            gated, "A gated 32 × 32 SPAD array behind a lens of 10°, read out as ToA words after each of 150,400 laser "
            "pulses a second. T is the gate: it opens 213 bins (8.0 m) after the pulse and shows 5.7 m. Response: a "
            "Gaussian of 500 ps FWHM, a fifth of it delayed by an exponential tail of 300 ps."),
        "scanner_141x141": (
            scanner, "A raster scanner over 11° × 11°, timed to 2 ps. T spans 1.38 m from 1.5 m on. Response: a "
            "Gaussian of 55 ps FWHM, 30 % of it delayed by an exponential tail of 100 ps."),
        "array_512x512": (
            array, "A 512 × 512 SPAD array behind a lens of 20° with some barrel distortion. T is the laser's period, "
            "51.2 ns: ranges beyond 7.7 m wrap. Response: a Gaussian of 200 ps FWHM, a fifth of it delayed by an "
            "exponential tail of 150 ps."),
    }


def text(sensor: SensorModel, about: str) -> str:
    """The JSON of a sensor for people to read and change: a line for each key, the response as whole numbers."""
    content = sensor_message.to_object(sensor)
    counts = np.rint(sensor.irf * (PEAK / sensor.irf.max())).astype(int)
    numbers = textwrap.fill(", ".join(map(str, counts)), 110, initial_indent="    ", subsequent_indent="    ")
    lines = {"x_about": json.dumps(about, ensure_ascii=False)}
    lines |= {key: f"[\n{numbers}\n  ]" if key == "irf" else json.dumps(value) for key, value in content.items()}
    return "{\n" + ",\n".join(f'  "{key}": {value}' for key, value in lines.items()) + "\n}\n"


def main(folder: Path) -> None:
    """Write them all."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, (sensor, about) in sensors().items():
        (folder / f"{name}.json").write_text(text(sensor, about), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
