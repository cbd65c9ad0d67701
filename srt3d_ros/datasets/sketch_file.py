"""The sketch file: a Sketch and its sensor in one .npz (docs/photon-file.md)."""

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sketch import Sketch, check_frequencies
from srt3d_ros.datasets.files import open_npz, read_errors, read_npz_arrays
from srt3d_ros.datasets.options import redescribed
from srt3d_ros.errors import InvalidInput, printable, require
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.new_files import atomic_write, check_replaceable, file_errors

# Each array, its kind of dtype and its number of dimensions. `sensor` is the JSON of the sensor message, in UTF-8.
FORM = {"frequencies": ("iu", 1), "sums": ("c", 3), "photons": ("iu", 2), "stamp_ns": ("iu", 0),
        "added_variance": ("f", 0), "sensor": ("u", 1), "notes": ("U", 1)}


def is_sketch(path: Path) -> bool:
    """Whether an .npz file has the arrays of a sketch; InvalidInput if it is none."""
    with open_npz(path) as archive:
        return {"sums.npy", "frequencies.npy"} <= set(archive.namelist())


def save(path: str | Path, sketch: Sketch, sensor: SensorModel, notes: tuple[str, ...] = ()) -> None:
    """Write a sketch file; it appears whole, or not at all.

    Raises:
        InvalidInput: another suffix than .npz, a sensor of other pixels, or a path that cannot be written.
    """
    path = Path(path)
    require(path.suffix.lower() == ".npz", "sketch file", path.name, "a name that ends in .npz")
    check_replaceable(path, "sums")
    _check(sketch, sensor)
    text = np.frombuffer(sensor_message.to_json(sensor).encode(), np.uint8)
    with file_errors("sketch file", path), atomic_write(path) as part:
        np.savez(part, frequencies=np.array(sketch.frequencies), sums=sketch.sums, photons=sketch.photons,
                 stamp_ns=np.int64(sketch.stamp_ns), added_variance=np.float64(sketch.added_variance), sensor=text,
                 notes=np.array(notes, str))


def read(path: str | Path) -> tuple[Sketch, SensorModel, tuple[str, ...]]:
    """The sketch of a sketch file, the sensor of its photons, and the notes on it.

    Raises:
        InvalidInput: naming the file and the array that cannot be used.
    """
    path = Path(path)
    arrays = read_npz_arrays(path, tuple(FORM), "sketch file")
    with read_errors(path):
        for name, (kinds, sides) in FORM.items():
            require(name in arrays, name, "missing", f"the arrays {', '.join(FORM)} of a sketch file")
            found = arrays[name]
            require(found.dtype.kind in kinds and found.ndim == sides, name, f"{found.dtype} {found.shape}",
                    "what Sketch.save writes")
        try:
            text = arrays["sensor"].astype(np.uint8).tobytes().decode()
        except UnicodeDecodeError as error:
            raise InvalidInput("sensor", f"broken text ({error})", "JSON in UTF-8") from None
        sensor = sensor_message.from_json(text)
        sums, photons = arrays["sums"].astype(np.complex64), arrays["photons"].astype(np.uint32)
        require(bool(np.isfinite(sums).all()), "sums", "not finite in places", "sums of unit vectors")
        notes = arrays["notes"].astype(arrays["notes"].dtype.newbyteorder("="))
        is_text = notes.nbytes == 0 or bool((notes.view(np.uint32) <= sys.maxunicode).all())
        require(is_text, "notes", "not text in places", "Unicode characters")
        frequencies, added_variance = arrays["frequencies"].tolist(), float(arrays["added_variance"])
        require(0 <= added_variance < np.inf, "added_variance", added_variance, "0 or more")
        sketch = Sketch(check_frequencies(frequencies, sensor.num_bins), sums, photons, int(arrays["stamp_ns"]),
                        added_variance)
        _check(sketch, sensor)
    return sketch, sensor, tuple(map(printable, notes.tolist()))


def with_options(sketch: Sketch, options: Mapping[str, Any]) -> Sketch:
    """A sketch with notes, with options (options.gathered) in place of what its sensor says; another note says which.

    Raises:
        InvalidInput: an option that would have made another sketch.
    """
    require("gate" not in options, "gate", options.get("gate"), "nothing: the sketch has been made without it")
    sensor, notes = redescribed(sketch.sensor, sketch.notes, options, ("rows", "cols", "num_bins", "toa_reference"))
    return replace(sketch, sensor=sensor, notes=notes)


def _check(sketch: Sketch, sensor: SensorModel) -> None:
    pixels = sensor.rows, sensor.cols
    require(sketch.photons.shape == pixels, "sketch size", sketch.photons.shape, f"{pixels}, the sensor's pixels")
