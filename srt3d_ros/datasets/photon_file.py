"""One frame with its sensor as .npz: photons (docs/photon-file.md) and, if known, true depths; or a sketch."""

from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonFrame, PhotonHistograms
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.datasets.arrays import with_options
from srt3d_ros.datasets.options import Options
from srt3d_ros.datasets.reading import Reading
from srt3d_ros.datasets.sensor_arrays import read_saved, sensor_arrays
from srt3d_ros.errors import require
from srt3d_ros.files.array_files import MAX_ARRAY_BYTES, read_errors
from srt3d_ros.files.new_files import atomic_write, check_output, file_errors

FIRST_REFERENCES = ("ref_depth_ml_bins", "ref_depth_bins")      # the better one first
MAX_REFERENCES = 8
OTHER_REFERENCES = tuple(f"ref_depth_bins_{k}" for k in range(2, MAX_REFERENCES + 1))


def save(path: str | Path, sensor: SensorModel, frame: PhotonFrame, reference_depth_bins: np.ndarray | None = None,
         notes: tuple[str, ...] = ()) -> None:
    """Write an .npz photon file atomically.

    Args:
        frame: photons; gates are written as events, counts as `counts`.
        reference_depth_bins: [rows, cols] or [S, rows, cols], NaN = unknown or no surface.
        notes: what was assumed about the photons; `read` gives them again.

    Raises:
        InvalidInput: another suffix, photons outside the sensor, a reference of another shape, or a path that cannot be
            written.
    """
    path = check_output(path, "toa", "counts", suffix=".npz")
    photons = frame if isinstance(frame, PhotonEvents | PhotonHistograms) else frame.to_events(sensor)
    photons.check(sensor)
    if isinstance(photons, PhotonEvents):
        arrays = {"pixel": photons.pixel, "toa": photons.toa}
    else:
        size = photons.counts.nbytes
        require(size <= MAX_ARRAY_BYTES, "counts size", f"{size} bytes", f"at most {MAX_ARRAY_BYTES}, to be read again")
        arrays = {"counts": photons.counts}
    arrays |= {"stamp_ns": np.int64(photons.stamp_ns)} | sensor_arrays(sensor, notes)
    if reference_depth_bins is not None:
        surfaces = np.asarray(reference_depth_bins, np.float32)
        surfaces = surfaces[None] if surfaces.ndim == 2 else surfaces
        fits = surfaces.shape[1:] == (sensor.rows, sensor.cols) and 1 <= len(surfaces) <= MAX_REFERENCES
        require(fits, "reference_depth_bins shape", np.shape(reference_depth_bins),
                f"[S, {sensor.rows}, {sensor.cols}], S from 1 to {MAX_REFERENCES}")
        arrays |= dict(zip((FIRST_REFERENCES[-1], *OTHER_REFERENCES), surfaces))
    with file_errors("photon file", path), atomic_write(path) as part, part.open("wb") as file:
        np.savez_compressed(file, **arrays)


def save_sketch(path: str | Path, sketch: PhaseSums, notes: tuple[str, ...] = ()) -> None:
    """Write a sketch atomically; `read` reads it to the bit.

    Its arrays are frequencies (int64), sums (complex64 [rows, cols, m]), photons and before (uint32 [rows, cols]),
    stamp_ns, sketch_cycles, notes, and the sensor's as in a photon file.

    Raises:
        InvalidInput: another suffix than .npz, or a file that cannot be written.
    """
    path = check_output(path, "sums", suffix=".npz")
    before = np.zeros((0, 0), np.uint32) if sketch.before is None else sketch.before
    with file_errors("output", path), atomic_write(path) as part, part.open("wb") as file:
        np.savez(file, kind="sketch", frequencies=sketch.frequencies, sums=sketch.sums, photons=sketch.photons,
                 before=before, stamp_ns=sketch.stamp_ns, sketch_cycles=sketch.cycles,
                 **sensor_arrays(sketch.sensor, notes))


def read_sketch(path: Path, options: Options) -> Reading:
    """A sketch that `save_sketch` wrote; options replace values of its sensor."""
    facts = ("stamp_ns", "sketch_cycles")
    sensor, values = read_saved(path, ("frequencies", "sums", "photons", "before", *facts))
    with read_errors(path):
        before, stamp_ns, cycles = values["before"], *(int(values[name]) for name in facts)
        fits = before.shape in ((0, 0), (sensor.rows, sensor.cols)) and before.dtype == np.uint32
        require(fits, "before", f"{before.dtype} {before.shape}", "uint32 of the sensor's pixels, or none")
        require(cycles >= 0, "sketch_cycles", cycles, "0 or more")
        sums = PhaseSums(values["frequencies"], values["sums"], values["photons"], stamp_ns, cycles,
                         before if before.size else None, sensor=sensor)
    return with_options(Reading(sensor, sums, None, path.stem, values["notes"]), options)
