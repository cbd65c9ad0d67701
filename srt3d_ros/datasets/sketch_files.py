"""Save a sketch as .npz, and read it again to the bit."""

from pathlib import Path

import numpy as np

from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.datasets.reading import Reading
from srt3d_ros.datasets.sensor_arrays import read_saved, sensor_arrays
from srt3d_ros.errors import require
from srt3d_ros.files.array_files import read_errors
from srt3d_ros.files.new_files import atomic_write, check_output, file_errors

FACTS = ("stamp_ns", "sketch_cycles")


def save(sketch: PhaseSums, path: str | Path, notes: tuple[str, ...] = ()) -> None:
    """Write frequencies (int64), sums (complex64 [rows, cols, m]), photons and before (uint32 [rows, cols]), stamp_ns,
    sketch_cycles, notes, and the sensor as in a photon file; the file appears whole, or not at all.

    Raises:
        InvalidInput: another suffix than .npz, or a file that cannot be written.
    """
    path = check_output(path, "sums", suffix=".npz")
    before = np.zeros((0, 0), np.uint32) if sketch.before is None else sketch.before
    with file_errors("output", path), atomic_write(path) as part, part.open("wb") as file:
        np.savez(file, kind="sketch", frequencies=sketch.frequencies, sums=sketch.sums, photons=sketch.photons,
                 before=before, stamp_ns=sketch.stamp_ns, sketch_cycles=sketch.cycles,
                 **sensor_arrays(sketch.sensor, notes))


def read(path: Path, options: dict) -> Reading:
    """A sketch that `save` wrote; options replace values of its sensor. InvalidInput if it is damaged."""
    sensor, values = read_saved(path, ("frequencies", "sums", "photons", "before", *FACTS))
    with read_errors(path):
        before, stamp_ns, cycles = values["before"], *(int(values[name]) for name in FACTS)
        fits = before.shape in ((0, 0), (sensor.rows, sensor.cols)) and before.dtype == np.uint32
        require(fits, "before", f"{before.dtype} {before.shape}", "uint32 of the sensor's pixels, or none")
        require(cycles >= 0, "sketch_cycles", cycles, "0 or more")
        sums = PhaseSums(values["frequencies"], values["sums"], values["photons"], stamp_ns, cycles,
                        before if before.size else None, sensor=sensor)
    return Reading(sensor, sums, None, path.stem, values["notes"]).with_options(options)
