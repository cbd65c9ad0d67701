"""What the named arrays of a file mean: photons one by one, counts, words of a SPAD array, or what `save` wrote."""

from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from srt3d_ros.datasets import cloud_files, photon_file
from srt3d_ros.datasets.arrays import from_counts, from_photons
from srt3d_ros.datasets.axes import SIZES
from srt3d_ros.datasets.options import FRAMES, Options
from srt3d_ros.datasets.photon_file import FIRST_REFERENCES, OTHER_REFERENCES
from srt3d_ros.datasets.reading import Reading, Said
from srt3d_ros.datasets.sensor_arrays import SENSOR_ARRAYS, sensor_options, values_of, vector
from srt3d_ros.datasets.values import MAX_EVENTS
from srt3d_ros.errors import finite, require
from srt3d_ros.files.array_files import read_errors
from srt3d_ros.files.isolated_child import may_be_counts

COLUMNS, PIXEL_COLUMNS = ("row", "col", "toa"), ("pixel", "toa")
PHOTON_ARRAYS = ("counts", "pixel", *COLUMNS)
BESIDE_PHOTONS = (*SENSOR_ARRAYS, "stamp_ns", *FIRST_REFERENCES, *OTHER_REFERENCES, "fov_deg")
KNOWN = (*BESIDE_PHOTONS, *PHOTON_ARRAYS, "kind")
# Of BESIDE_PHOTONS, what any counts may have beside them. Sizes are numbers: arrays of these names are coordinates.
BESIDE_COUNTS = ("irf", "irf_ref", "bin_width_s", "toa_offset_bins", "range_offset_m", "cycles", "dead_time_s",
                 "period_s", "fov_deg")
PHOTONS = "row, col (or pixel) and toa of each photon (other names: --columns ROW,COL,TOA, or srt3d_ros.from_events)"
WANTED = f"one numeric array [rows, cols, bins], or {PHOTONS}"
WORD_AXES = (FRAMES, "rows", "cols")
WORDS_AT_ONCE = 2**24
MUCH_PILE_UP = 0.05         # photons a pixel and frame, above which early photons hide late ones


class Content(NamedTuple):
    """What a reader finds in a file.

    Args:
        arrays: by the names of docs/photon-file.md, or by the file's own; numbers, too.
        options: those that the reader has not followed.
        notes: on what it chose.
        listed: what the file has, for an error.
        wanted: what it should have; "" if the reader knows which arrays are the photons.
    """

    arrays: dict[str, Any]
    options: Options
    notes: tuple[str, ...] = ()
    listed: str = ""
    wanted: str = ""


def reading_of(path: Path, content: Content) -> Reading:
    """The photons, sketch or cloud in a file; InvalidInput names the file and the array that cannot be used."""
    kind = content.arrays.get("kind")       # anyone's
    for name, read in (("cloud", cloud_files.read), ("sketch", photon_file.read_sketch)):
        if np.array_equal(kind, name):
            return read(path, content.options)
    with read_errors(path):
        if content.wanted and content.options.no_detection is not None:
            content = _of_words(content)
        one_by_one = content.options.columns is not None or not {"pixel", "toa"}.isdisjoint(content.arrays)
        return (_photons if one_by_one else _counts)(path, content)


def _photons(path: Path, content: Content) -> Reading:
    """Photons one by one: row, column and ToA; or pixel and ToA; or the ToA of a single pixel."""
    arrays, options = content.arrays, content.options
    columns = options.columns or (PIXEL_COLUMNS if "pixel" in arrays else COLUMNS)
    for name in columns:
        require(name in arrays, name, problem=f"The file has no {name}. It needs {PHOTONS}. It has {content.listed}.")
        require(arrays[name].dtype.kind in "iufb", f"{name} dtype", str(arrays[name].dtype), "numbers")
        require(arrays[name].size <= MAX_EVENTS, "photons", arrays[name].size, f"at most {MAX_EVENTS}")
    photons = [vector(arrays[name]) for name in columns]
    said = _said(path, content, {*BESIDE_PHOTONS} - {*columns})
    if len(photons) == 1:
        photons.insert(0, np.zeros(photons[0].shape, np.uint8))
        said.sensor.update({name: 1 for name in SIZES[:2] if name not in options.known | said.sensor})
    for name in SIZES:
        require(name in options.known | said.sensor, name,
                problem=f"The file has no {name}: give it as an option or array. It has {content.listed}.")
    return from_photons(tuple(photons), options.without("columns"), said)


def _counts(path: Path, content: Content) -> Reading:
    """Photons of an array of counts. Beside other counts than those of a photon file, few names mean something."""
    name, content = _chosen(content) if content.wanted else ("counts", content)
    sizes = {size for size in SIZES if np.size(content.arrays.get(size, ())) == 1}
    of_photon_file = name == "counts" and sizes >= {*SIZES[:2]} and not content.options.axes
    said = _said(path, content, ({*BESIDE_PHOTONS} if of_photon_file else {*BESIDE_COUNTS} | sizes) - {name})
    return from_counts(content.arrays[name], content.options, said, tuple(content.arrays.get(f"{name}.dims", ())))


def _of_words(content: Content) -> Content:
    """The photons of an array of words [frames, rows, cols], or ordered as `axes`: ToA = word − `first_word`.

    A word `no_detection`, or NaN, is no photon.
    """
    name, (arrays, options, *_) = _chosen(content)
    words, order = arrays[name], options.axes or WORD_AXES
    fits = words.ndim == 3 and words.dtype.kind in "iuf" and words.size > 0
    require(fits, "words", f"{words.dtype} {words.shape}", "numbers [frames, rows, cols]")
    require({*order} == {*WORD_AXES}, "axes", ",".join(order),
            f"{', '.join(WORD_AXES)} in the order of the array of words")
    words = words.transpose([order.index(name) for name in WORD_AXES])
    frames, rows, cols = words.shape
    none, first = (finite(name, getattr(options, name) or 0) for name in ("no_detection", "first_word"))
    pixels, toas, step = [], [], max(WORDS_AT_ONCE // (rows * cols), 1)
    for begin in range(0, frames, step):
        part = words[begin:begin + step].reshape(-1, rows * cols)
        at = np.nonzero((part != none) & ~np.isnan(part))
        pixels.append(at[1].astype(np.uint32))
        toas.append((part[at].astype(np.float64) - first).astype(np.float32))
        require(sum(map(len, toas)) <= MAX_EVENTS, "photons", f"more than {MAX_EVENTS}", "fewer: leave frames out")
    pixel, toa = np.concatenate(pixels), np.concatenate(toas)
    by_pixel, share = np.argsort(pixel, kind="stable"), len(toa) / words.size       # sketched several times faster
    note = (f"{share:.0%} of the words are photons: if a frame is one laser cycle, give cycles={frames} (--cycles) to "
            "correct pile-up")
    notes = (note,) if share > MUCH_PILE_UP and not options.known.get("cycles") else ()
    arrays = arrays | {"pixel": pixel[by_pixel], "toa": toa[by_pixel], "rows": rows, "cols": cols}
    return content._replace(arrays=arrays, notes=notes, options=options.without("axes", "no_detection", "first_word"))


def _chosen(content: Content) -> tuple[str, Content]:
    """The name of the array of counts or words: the option `array`, `counts`, or the only one that may hold some."""
    arrays, name = content.arrays, content.options.array
    if name is not None:
        require(name in arrays, "array", problem=f"The file has no {name}. It has {content.listed}.")
        return name, content._replace(options=content.options.without("array"))
    cubes = [name for name, values in arrays.items() if isinstance(values, np.ndarray)
             and values.dtype.kind in "iufb" and may_be_counts(values.shape, str(values.dtype))]
    cubes = ["counts"] if "counts" in cubes else cubes
    require(len(cubes) == 1, "counts",
            problem=f"The file needs {content.wanted}, or array (--array NAME). It has {content.listed}.")
    return cubes[0], content


def _said(path: Path, content: Content, names: set[str]) -> Said:
    """What the arrays of these names, beside those of photons, say."""
    values = values_of({name: np.asarray(content.arrays[name]) for name in names & content.arrays.keys()})
    first = next((name for name in FIRST_REFERENCES if name in values), "")
    surfaces = [first, *takewhile(values.__contains__, OTHER_REFERENCES)] if first else []
    for name in surfaces:
        fits = values[name].ndim == 2 and values[name].shape == values[first].shape
        require(fits, f"{name} shape", values[name].shape, "[rows, cols]")
    depths = np.stack([values[name] for name in surfaces]).astype(np.float32) if surfaces else None
    return Said(sensor_options(values), (*values.get("notes", ()), *content.notes), path.stem, depths,
                int(values.get("stamp_ns", 0)))
