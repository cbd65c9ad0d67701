"""Apply the caller's options and sensor to what a file says: the caller wins, and a note lists the replaced values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Self, TypedDict

import numpy as np

from srt3d_ros.core.keys import Key, keys
from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.difference import first_difference
from srt3d_ros.core.sensor.model import SPEED_OF_LIGHT, SensorModel
from srt3d_ros.core.sensor.projection import DEFAULT_FOV_DEG, Pinhole, Projection
from srt3d_ros.core.sketching.gate import parse
from srt3d_ros.datasets import irf as irfs
from srt3d_ros.datasets import irf_files
from srt3d_ros.datasets.values import Note, array
from srt3d_ros.errors import finite, quoted, require

BIN_OF_ONE_METRE_S = 2 / SPEED_OF_LIGHT      # assumed if the bin width is unknown: x, y, z then count bins
MAX_PERIOD_M = 1e6      # no laser waits 7 ms for its echoes
ASSUMED_WIDTH = Note("bin width taken as 2 / 299792458 s: x, y and z count bins, not metres: give bin_width_s "
                     "(--bin-width-s)", "bin_width_s")
ASSUMED_FOV = Note(f"geometry taken to be a pinhole of {DEFAULT_FOV_DEG:g}° across the larger side: give fov_deg "
                   "(--fov-deg), or the projection", "projection")
HALF_BIN_M = 1e-3       # a range error that is not said
FIELDS = tuple(SensorModel.__dataclass_fields__)
SENSOR_DEFAULTS = {name: key.default for name, key in keys(SensorModel).items()}
Values = np.ndarray | Sequence
AXES, FRAMES = ("rows", "cols", "bins"), "frames"
FILE_OPTIONS = {"channel": "Only .ptu, .phu, .sdt and Photon-HDF5 files have channels.",
                "axes": "Only arrays of counts have axes.",
                "array": "Only .npz, HDF5 and .mat files of counts have arrays to choose from.",
                "reversed": "Only photon files have reversed; photons have the method reversed().",
                "no_detection": "Only .npy, .npz, HDF5 and .mat files of words [frames, rows, cols] have no_detection.",
                "first_word": "first_word needs no_detection, and a file of words [frames, rows, cols].",
                "columns": "Only .npz, HDF5, .mat and .csv files of photons have columns."}
PIXEL_MAPS = tuple(name for name, key in keys(SensorModel).items() if key.dtype and name != "irf")


class SensorOptions(TypedDict, total=False):
    """Options that describe photons, all but these as of Sensor, and how to read a file: docs/photon-file.md."""

    shape: Annotated[tuple[int, int], Key("(rows, cols)")]
    rows: int
    cols: int
    num_bins: int
    bin_width_s: float
    irf: Annotated[Values | str | Path, Key(
        "impulse response; a file may be .npz (its array irf), .npy, .mat, text, .sdt, .ptu or .phu",
        more="text has one number a line, or time and IRF, below any header; other steps than the bins are resampled",
        option=True)]
    irf_ref: int
    irf_sigma_bins: Annotated[float, Key("standard deviation of a Gaussian IRF", "bin", more="in place of irf")]
    fov_deg: Annotated[float, Key("field of view across the larger side, degrees", more="of a pinhole",
                                  option=True)]
    projection: Projection
    toa_offset_bins: float
    range_offset_m: float
    gain: Values
    delay_bins: Values
    mask: Annotated[Values | str, Key(
        "auto: leave out hot pixels (default, unless file or sensor say which); off: keep them",
        more="or an array [rows, cols], false where a pixel must not be used", option=True)]
    background_shape: Values
    histograms: HistogramBins
    cycles: int
    dead_time_s: float
    period_s: float
    frame_id: str
    extrinsics: str
    gate: Annotated[tuple[int, int], Key(
        "first and last bin to keep (--gate FIRST-LAST)", more="T becomes the number of bins plus the spread of the "
        "pixels' delays, toa_offset_bins grows by the first bin, and photons outside are dropped and counted in notes")]
    channel: Annotated[int, Key("detector channel or data set (default: brightest; all for Photon-HDF5)", option=True)]
    array: Annotated[str, Key("name of the array of counts, if the file has several", option=True)]
    axes: Annotated[str | tuple[str, ...], Key(
        "order of the axes of an array of counts: bins,rows,cols (default: rows,cols,bins, or what the file states)",
        more="of one with four axes, with frames, too", option=True)]
    reversed: Annotated[bool, Key(
        "times run backwards, from the photon to the next laser pulse",
        more="bin b becomes T − 1 − b, of irf and background_shape, too; gate counts after that", option=True)]
    no_detection: Annotated[float, Key(
        "the array has the words of a SPAD array [frames, rows, cols], with this one where a pixel saw nothing",
        option=True)]
    first_word: Annotated[float, Key("word of bin 0 (default: 0)", more="with no_detection", option=True)]
    columns: Annotated[str | tuple[str, ...], Key(
        "names of the arrays with row, column and ToA of each photon (default: row,col,toa)",
        more="y,x,t say; two are pixel index and ToA, one the ToA of a single pixel; in an HDF5 group or table scan/y",
        option=True)]


def option_keys() -> dict[str, Key]:
    """What each option of SensorOptions means, by name."""
    known = keys(SensorModel) | keys(SensorOptions)
    return {name: known[name] for name in SensorOptions.__annotations__}


# Values of a sensor by the names of SensorModel's fields, and fov_deg, irf_steps (as irf_files.read gives them).
Known = dict[str, Any]


@dataclass(frozen=True)
class Options:
    """What the caller says: what is known of the sensor, and how to read a file (None = not given).

    A reader passes on `without` what it has followed, since `sensor_of` refuses what nobody has.
    """

    known: Known = field(default_factory=dict)
    gate: tuple[int, int] | None = None
    channel: int | None = None
    array: str | None = None
    axes: tuple[str, ...] | None = None
    columns: tuple[str, ...] | None = None
    no_detection: float | None = None
    first_word: float | None = None
    reversed: bool | None = None
    guess_irf: bool = False         # one bin if none can be estimated
    mask_hot: bool | None = None    # leave out hot pixels; None: if nobody gives a mask
    frame: int = 0                  # of a file with several

    @property
    def named(self) -> tuple[str, ...]:
        """Names of arrays that the caller wants."""
        return (*(self.columns or ()), *([self.array] if self.array else ()))

    def without(self, *names: str) -> Self:
        """The other options."""
        return replace(self, **dict.fromkeys(names))

    def knowing(self, **values: Any) -> Self:
        """The options with these values of the sensor in place of others."""
        return replace(self, known=self.known | values)

    def over(self, own: Known, notes: tuple[str, ...] = (), fixed: tuple[str, ...] = ("rows", "cols")
             ) -> tuple[Self, tuple[str, ...]]:
        """These options on top of what a file says of its sensor, and its notes.

        Assumptions that the options answer are left out of the notes, and one says which values were replaced.

        Raises:
            InvalidInput: the options contradict a `fixed` value.
        """
        for name in fixed:
            value = self.known.get(name, own.get(name))
            require(name not in own or value == own[name], name, quoted(value), f"{own.get(name)}, as in the file")
        own, known = _in_angles(own, own | self.known), _in_angles(self.known, own | self.known)
        answered = {*known, *(["irf_ref"] if "irf" in known else ()), *(["gate"] if self.gate else ()),
                    *(["toa_offset_bins"] if "range_offset_m" in known else ())}
        left, assumed = [], set()
        for note in notes:
            about = note.field if isinstance(note, Note) else ""
            assumed |= {about, f"{about}_ref"}
            left += [] if about in answered else [note]
        said = {name: value for name, value in own.items() if name not in assumed}
        own = {name: value for name, value in own.items() if name != "irf_ref" or "irf" not in known}
        return replace(self, known=own | known), (*left, *replaced_note(said, known))


def gathered(given: Mapping[str, Any], sensor: SensorModel | None = None, guess_irf: bool = False) -> Options:
    """The given options, on top of the sensor's fields; None counts as not given.

    `irf` becomes an array and replaces the sensor's irf_ref, too; `shape` becomes rows and cols.

    Raises:
        InvalidInput: an unknown name, or a value that cannot be used.
    """
    given = {name: value for name, value in given.items() if value is not None}
    for name in given:
        require(name in SensorOptions.__annotations__, "option name", quoted(name),
                f"one of {', '.join(SensorOptions.__annotations__)}")
    for name, other in (("fov_deg", "projection"), ("irf_sigma_bins", "irf")):
        require(not {name, other} <= given.keys(), name, problem=f"Give {name} or {other}, not both.")
    require(sensor is None or isinstance(sensor, SensorModel), "sensor", type(sensor).__name__, "a Sensor")
    if sensor is not None and given.get("reversed"):        # what a reading of the file turns round again
        sensor = backwards(sensor)
    known = {} if sensor is None else fields_of(sensor)
    if "shape" in given:
        shape = array("shape", given.pop("shape"))
        require(shape.shape == (2,), "shape", shape.tolist(), "(rows, cols)")
        given["rows"], given["cols"] = shape.tolist()
    if "gate" in given:
        given["gate"] = gate = parse(given["gate"])
        require(not isinstance(gate, str), "gate", quoted(gate), "first and last bin, both kept")
    given |= {name: _names(name, given[name]) for name in ("axes", "columns") if name in given}
    mask_hot = None
    if isinstance(mask := given.get("mask"), str):
        require(mask in ("auto", "off"), "mask", quoted(mask), "auto, off, or an array [rows, cols]")
        mask_hot = given.pop("mask") == "auto"
    given |= {name: array(name, given[name]) for name in PIXEL_MAPS if name in given}
    if "irf_sigma_bins" in given:
        given["irf"] = irfs.gaussian(finite("irf_sigma_bins", given.pop("irf_sigma_bins"), "bins, above 0"))
    elif "irf" in given:
        given["irf"], given["irf_steps"] = irf_files.read(given["irf"])
    if "irf" in given:
        known.pop("irf_ref", None)
    if "fov_deg" in given:
        known.pop("projection", None)
    of_file = {name: given.pop(name) for name in ("gate", *FILE_OPTIONS) if name in given}
    return Options(known | given, guess_irf=guess_irf, mask_hot=mask_hot, **of_file)


def fields_of(sensor: SensorModel) -> Known:
    """All values of a sensor."""
    return {name: getattr(sensor, name) for name in FIELDS}


def backwards(sensor: SensorModel) -> SensorModel:
    """The sensor of reversed times: bin b is T − 1 − b."""
    shape = sensor.background_shape
    return sensor.replace(irf=sensor.irf[..., ::-1], irf_ref=sensor.irf.shape[-1] - 1 - (sensor.irf_ref or 0),
                          background_shape=None if shape is None else shape[::-1])


def sensor_of(options: Options, own: Known | None = None, notes: tuple[str, ...] = (),
              fixed: tuple[str, ...] = ("rows", "cols")) -> tuple[SensorModel, Options, tuple[str, ...]]:
    """The sensor that the options describe on top of a file's `own` values (Options.over), its IRF of one bin if
    nobody has one; the options with these values; and all notes.

    Raises:
        InvalidInput: a value is missing or cannot be used, or nobody has followed an option on how to read a file.
    """
    options, notes = options.over(own or {}, notes, fixed)
    known = options.known
    for name, problem in FILE_OPTIONS.items():
        require(getattr(options, name) is None, name, problem=problem)
    require({"rows", "cols"} <= known.keys(), "shape", problem="Give shape=(rows, cols), or sensor.")
    require("num_bins" in known, "num_bins", problem="Give num_bins, the bins of a laser period, or sensor.")
    require("irf" in known or "irf_ref" not in known, "irf_ref", problem="irf_ref needs irf.")
    fields = {name: known[name] for name in FIELDS if name in known and name not in ("irf", "irf_ref")}
    sensor = SensorModel(**{"bin_width_s": BIN_OF_ONE_METRE_S, "irf": np.ones(1)} | fields)
    notes += () if "bin_width_s" in known else (ASSUMED_WIDTH,)
    if "irf" in known:          # it is brought into the bins of the other values
        steps, width_known = known.get("irf_steps", irf_files.Steps()), sensor.bin_width_s != BIN_OF_ONE_METRE_S
        irf, ref, of_file = irf_files.fitted(known["irf"], known.get("irf_ref"), steps, sensor, width_known)
        irf, checked = irfs.checked(irf, known.get("irf_ref"))
        sensor, notes = sensor.replace(irf=irf, irf_ref=ref), notes + of_file + checked
    require(known.get("mask") is None or bool(sensor.used.any()), "mask",
            problem="mask is False everywhere: True marks the pixels to use.")
    period_m = sensor.num_bins * sensor.bin_width_m
    require(period_m <= MAX_PERIOD_M, "bin_width_s", problem=f"{sensor.num_bins} bins of {sensor.bin_width_s:g} s "
            f"reach {period_m:.3g} m: give bin_width_s in seconds, 1e-10 for 100 ps.")
    return sensor, options, notes


def replaced_note(own: Known, now: Known) -> tuple[str, ...]:
    """The note on values of a file that were replaced, if any."""
    changed = {name for name, value in own.items() if name in now and not _same(value, now[name])
               and not _same(value, SENSOR_DEFAULTS.get(name))}
    if "irf" in changed:
        changed.discard("irf_ref")
    names = ", ".join(name for name in own if name in changed)
    return (f"as given, not as in the file: {names}",) if names else ()


def _in_angles(known: Known, all_known: Known) -> Known:
    """What is known, with the projection in place of fov_deg."""
    if "fov_deg" not in known or not {"rows", "cols"} <= all_known.keys():
        return known
    fov_deg = finite("fov_deg", known["fov_deg"], "an angle between 0 and 180 degrees")
    pinhole = Pinhole.from_fov(*(int(finite(name, all_known[name])) for name in ("rows", "cols")), fov_deg)
    return {name: value for name, value in known.items() if name != "fov_deg"} | {"projection": pinhole}


def _names(option: str, value: Any) -> tuple[str, ...]:
    """Up to three columns, or the order of AXES, perhaps with or of FRAMES, as a text with commas or one by one."""
    names = tuple(name.strip().strip("/") for name in value.split(",")) if isinstance(value, str) else value
    expected = "rows, cols and bins in the order of the array" if option == "axes" else \
        "the arrays of row, col and ToA, of pixel and ToA, or of ToA"
    fits = isinstance(names, list | tuple) and len(names) in (1, 2, 3, 4) and all(
        isinstance(x, str) and x for x in names)
    known = {*AXES}, {*AXES, FRAMES}, {FRAMES, *AXES[:2]}
    require(fits and (len({*names}) == len(names) and {*names} in known if option == "axes" else len(names) < 4),
            option, quoted(value), expected)
    return tuple(names)


def _same(one: Any, other: Any) -> bool:
    if np.ndim(one) and np.ndim(other):         # scaled to sum 1: IRFs are given in any unit
        with np.errstate(invalid="ignore"):
            one, other = (np.asarray(values, np.float64) / max(np.sum(values), 1e-300) for values in (one, other))
        return one.shape == other.shape and np.allclose(one, other, rtol=1e-5, atol=0)
    return first_difference(one, other) is None
