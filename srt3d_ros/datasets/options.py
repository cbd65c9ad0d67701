"""Apply the caller's options and sensor to what a file says: the caller wins, and a note lists the replaced values."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, TypedDict

import numpy as np

from srt3d_ros.core.keys import Key, keys
from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.difference import first_difference
from srt3d_ros.core.sensor.model import SPEED_OF_LIGHT, SensorModel
from srt3d_ros.core.sensor.projection import DEFAULT_FOV_DEG, Pinhole, Projection
from srt3d_ros.core.sketching.gate import parse
from srt3d_ros.datasets import irf as irfs
from srt3d_ros.datasets.values import array
from srt3d_ros.errors import finite, quoted, require

BIN_OF_ONE_METRE_S = 2 / SPEED_OF_LIGHT      # assumed if the bin width is unknown: x, y, z then count bins
MAX_PERIOD_M = 1e6      # no laser waits 7 ms for its echoes
ASSUMED_WIDTH = ("bin width taken as 2 / 299792458 s: x, y and z count bins, not metres: give bin_width_s "
                 "(--bin-width-s)")
ASSUMED_FOV = (f"geometry taken to be a pinhole of {DEFAULT_FOV_DEG:g}° across the larger side: give fov_deg "
               "(--fov-deg), or the projection")
ASSUMPTIONS = {"projection": "geometry ", "irf": "IRF ", "bin_width_s": "bin width "}     # beginnings of their notes
SENSOR_OPTIONS = tuple(name for name in SensorModel.__dataclass_fields__ if name not in ("rows", "cols"))
SENSOR_DEFAULTS = {field.name: field.default for field in fields(SensorModel)}
Values = np.ndarray | Sequence
AXES = ("rows", "cols", "bins")
FILE_OPTIONS = {"channel": "Only .ptu, .sdt and Photon-HDF5 files have channels.",
                "axes": "Only arrays of counts have axes.",
                "columns": "Only .npz, HDF5 and .mat files of photons have columns."}
PIXEL_MAPS = tuple(name for name, key in keys(SensorModel).items() if key.dtype and name != "irf")


class SensorOptions(TypedDict, total=False):
    """Options that describe photons, all but these as of Sensor, and how to read a file: docs/photon-file.md."""

    shape: Annotated[tuple[int, int], Key("(rows, cols)")]
    rows: int
    cols: int
    num_bins: int
    bin_width_s: float
    irf: Annotated[Values | str | Path, Key(
        "impulse response; a file may be .npz (its array irf), .npy, .mat, .csv or .txt",
        more="of .mat its irf, or its only vector; of text one number a line, or time and IRF, below any header. Times "
        "must advance by a bin a line", option=True)]
    irf_ref: int
    irf_sigma_bins: Annotated[float, Key("standard deviation of a Gaussian IRF", "bin", more="in place of irf")]
    fov_deg: Annotated[float, Key("field of view across the larger side, degrees", more="of a pinhole",
                                  option=True)]
    projection: Projection
    toa_offset_bins: float
    range_offset_m: float
    gain: Values
    delay_bins: Values
    mask: Values
    background_shape: Values
    histograms: HistogramBins
    cycles: int
    frame_id: str
    gate: Annotated[tuple[int, int], Key(
        "first and last bin to keep (--gate FIRST-LAST)", more="T becomes the number of bins plus the spread of the "
        "pixels' delays, toa_offset_bins grows by the first bin, and photons outside are dropped and counted in notes")]
    channel: Annotated[int, Key("detector channel or data set (default: brightest; all for Photon-HDF5)", option=True)]
    axes: Annotated[str | tuple[str, str, str], Key(
        "order of the axes of an array of counts: bins,rows,cols (default: rows,cols,bins)", option=True)]
    columns: Annotated[str | tuple[str, str, str], Key(
        "names of the arrays with row, column and ToA of each photon (default: row,col,toa)",
        more="y,x,t say; in a group of HDF5 scan/y", option=True)]


def option_keys() -> dict[str, Key]:
    """What each option of SensorOptions means, by name."""
    known = keys(SensorModel) | keys(SensorOptions)
    return {name: known[name] for name in SensorOptions.__annotations__}


def gathered(given: Mapping[str, Any], sensor: SensorModel | None = None) -> dict[str, Any]:
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
    options = {}
    if sensor is not None:
        require(isinstance(sensor, SensorModel), "sensor", type(sensor).__name__, "a Sensor")
        options = {name: getattr(sensor, name) for name in ("rows", "cols", *SENSOR_OPTIONS)}
    if "shape" in given:
        shape = array("shape", given.pop("shape"))
        require(shape.shape == (2,), "shape", shape.tolist(), "(rows, cols)")
        given["rows"], given["cols"] = shape.tolist()
    if "gate" in given:
        given["gate"] = gate = parse(given["gate"])
        require(not isinstance(gate, str), "gate", quoted(gate), "first and last bin, both kept")
    for name in ("axes", "columns"):
        if name in given:
            given[name] = _three_names(name, given[name])
    for name in PIXEL_MAPS:
        if name in given:
            given[name] = array(name, given[name])
    if "irf_sigma_bins" in given:
        given["irf"] = irfs.gaussian(finite("irf_sigma_bins", given.pop("irf_sigma_bins"), "bins, above 0"))
    elif "irf" in given:
        given["irf"], options["irf_times"] = irfs.read(given["irf"])
    if "irf" in given:
        options.pop("irf_ref", None)
    if "fov_deg" in given:
        options.pop("projection", None)
    return options | given


def described(sensor: SensorModel, options: Mapping[str, Any]) -> SensorModel:
    """The sensor with the options that describe a sensor in place of its own values."""
    changes = {name: options[name] for name in SENSOR_OPTIONS if name in options}
    if "irf" in changes:        # irf_ref belongs to the replaced IRF
        changes = {"irf_ref": None} | changes
    if "fov_deg" in options:
        fov_deg = finite("fov_deg", options["fov_deg"], "an angle between 0 and 180 degrees")
        changes["projection"] = Pinhole.from_fov(sensor.rows, sensor.cols, fov_deg)
    found = sensor.replace(**changes) if changes else sensor
    if "mask" in options and found.mask is not None:
        require(bool(found.mask.any()), "mask", problem="mask is False everywhere: True marks the pixels to use.")
    period_m = found.num_bins * found.bin_width_m
    require(period_m <= MAX_PERIOD_M, "bin_width_s", problem=f"{found.num_bins} bins of {found.bin_width_s:g} s reach "
            f"{period_m:.3g} m: give bin_width_s in seconds, 1e-10 for 100 ps.")
    if options.get("irf_times"):
        options["irf_times"].check(found.bin_width_s)
    return found


def redescribed(sensor: SensorModel, notes: tuple[str, ...], options: Mapping[str, Any],
                fixed: tuple[str, ...] = ("rows", "cols")) -> tuple[SensorModel, tuple[str, ...]]:
    """The sensor of given photons with options in place of its own values (but `fixed` ones), and the new notes."""
    refuse_file_options(options)
    check_same({name: getattr(sensor, name) for name in fixed}, options)
    changed = described(sensor, options)
    before, after = ({name: getattr(one, name) for name in SENSOR_OPTIONS} for one in (sensor, changed))
    for name, beginning in ASSUMPTIONS.items():
        others = tuple(note for note in notes if not note.startswith(beginning))
        given = says_geometry(options) if name == "projection" else name in options
        if given and others != notes:       # an assumption is replaced, not a value of the file
            notes = others
            before = {key: value for key, value in before.items() if key not in (name, f"{name}_ref")}
    return changed, notes + replaced_note(before, after)


def says_geometry(options: Mapping[str, Any]) -> bool:
    """Whether the options state the pixels' angles."""
    return "fov_deg" in options or options.get("projection") is not None


def replaced_note(own: Mapping[str, Any], now: Mapping[str, Any]) -> tuple[str, ...]:
    """The note on values of a file that were replaced, if any."""
    said = {name: value for name, value in own.items() if not _same(value, SENSOR_DEFAULTS.get(name))}
    names = [name for name in said if name in now and not _same(said[name], now[name])
             and not (name == "irf_ref" and "irf" in said and not _same(said["irf"], now.get("irf")))]
    return (f"as given, not as in the file: {', '.join(names)}",) if names else ()


def check_same(own: Mapping[str, Any], options: Mapping[str, Any]) -> None:
    """Raise InvalidInput if an option differs from the file."""
    for name, value in own.items():
        require(options.get(name, value) == value, name, quoted(options.get(name)), f"{value}, as in the file")


def refuse_file_options(options: Mapping[str, Any]) -> None:
    """Raise InvalidInput if the options say how to read a file: the reader removes those that it has followed."""
    for name, problem in FILE_OPTIONS.items():
        require(name not in options, name, problem=problem)


def in_order(counts: np.ndarray, options: dict) -> tuple[np.ndarray, dict, tuple[str, ...]]:
    """Counts [rows, cols, bins] by the option `axes`, the other options, and a note if they may need `axes`."""
    others = {name: value for name, value in options.items() if name != "axes"}
    if "axes" not in options or counts.ndim != 3:
        notes = few_bins_note(counts.shape)
        fits = not notes or "irf" not in options or options["irf"].shape[-1] <= counts.shape[2]
        require(fits, "axes", problem=f"The IRF is longer than the period: {''.join(notes)}.")
        return counts, others, notes
    return counts.transpose([options["axes"].index(name) for name in AXES]), others, ()


def few_bins_note(shape: tuple[int, ...]) -> tuple[str, ...]:
    """The note on counts that may be [bins, rows, cols], judged by their sides."""
    first, *others = shape
    suspicious = len(shape) == 3 and (first > max(others) or 1 < shape[2] < min(shape[:2]))
    note = (f"{' × '.join(map(str, shape))} taken for rows × cols × bins: if the first axis has the bins, give "
            "axes=bins,rows,cols (--axes)")
    return (note,) if suspicious else ()


def outside_note(dropped: int, photons: int, first: int, last: int) -> tuple[str, ...]:
    """The note on photons that a gate drops, if any."""
    note = f"{dropped} of {photons} photons lie outside the gate (bins {first} to {last}): dropped"
    return (note,) if dropped else ()


def _three_names(option: str, value: Any) -> tuple[str, ...]:
    """Three names, or the order of AXES, given as a text with commas or one by one."""
    names = tuple(name.strip().strip("/") for name in value.split(",")) if isinstance(value, str) else value
    expected = "rows, cols and bins in the order of the array" if option == "axes" else "the arrays of row, col and ToA"
    fits = isinstance(names, list | tuple) and len(names) == 3 and all(isinstance(name, str) and name for name in names)
    require(fits and (option != "axes" or set(names) == set(AXES)), option, quoted(value), expected)
    return tuple(names)


def _same(one: Any, other: Any) -> bool:
    if np.ndim(one) and np.ndim(other):         # scaled to sum 1: IRFs are given in any unit
        one, other = (np.asarray(values, np.float64) / max(np.sum(values), 1e-300) for values in (one, other))
        return one.shape == other.shape and np.allclose(one, other, rtol=1e-5, atol=0)
    return first_difference(one, other) is None
