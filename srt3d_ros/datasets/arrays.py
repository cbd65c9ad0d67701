"""Arrays in memory → Photons: row, col and ToA of each photon, or counts of photons [rows, cols, bins]."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from srt3d_ros.core.histogram_bins import HistogramBins
from srt3d_ros.core.photons import PhotonEvents, PhotonFrame, PhotonGates, PhotonHistograms
from srt3d_ros.core.projection import Projection
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets import irf as irfs
from srt3d_ros.datasets import photons
from srt3d_ros.datasets.photons import ASSUMED_FOV, Photons
from srt3d_ros.datasets.stream import PhotonStream
from srt3d_ros.datasets.survey import Survey
from srt3d_ros.errors import InvalidInput, require

NAME = "arrays"
OPTIONS = ("shape", "fov_deg", *photons.SENSOR_OPTIONS)
ESTIMATED_IRF = "IRF estimated from the photons, which makes it slightly broad: give irf"
NO_BIN_WIDTH = "seconds in a bin (where bins alone matter 2 / 299792458: x, y and z then count bins, not metres)"


class SensorOptions(TypedDict, total=False):
    """What the photons do not say: `shape` is (rows, cols), `fov_deg` makes a pinhole, the rest are of SensorModel."""

    shape: tuple[int, int]
    num_bins: int
    bin_width_s: float
    irf: ArrayLike | str | Path
    irf_ref: int
    fov_deg: float
    projection: Projection
    toa_offset_bins: float
    range_offset_m: float
    toa_reference: str
    gain: ArrayLike
    delay_bins: ArrayLike
    mask: ArrayLike
    background_shape: ArrayLike
    histograms: HistogramBins
    frame_id: str


def from_events(row: Any, col: Any, toa: Any, sensor: SensorModel | None, stamp_ns: int, options: SensorOptions
                ) -> Photons:
    """The photons of one entry each; arguments as of `srt3d_ros.photons`."""
    arrays = {"row": row, "col": col, "toa": toa}
    for name, values in arrays.items():
        require(values is not None, name, "missing", "row, col and toa, one entry a photon; or counts")
    row, col, toa = (_array(name, values) for name, values in arrays.items())
    fits = row.ndim == 1 and row.shape == col.shape == toa.shape
    require(fits, "row, col and toa shapes", f"{row.shape}, {col.shape}, {toa.shape}", "the same [N], one a photon")
    sensor, assumed = _sensor(sensor, options, {})
    pixel = _indices("row", row, sensor.rows) * np.uint32(sensor.cols) + _indices("col", col, sensor.cols)
    return _complete(PhotonEvents(pixel, _times(toa, sensor), stamp_ns), sensor, assumed)


def from_counts(counts: Any, sensor: SensorModel | None, stamp_ns: int, options: SensorOptions) -> Photons:
    """The photons of histograms [rows, cols, bins]; arguments as of `srt3d_ros.photons`."""
    counts = _array("counts", counts)
    require(counts.ndim == 3, "counts", f"{counts.dtype} {counts.shape}", "numbers [rows, cols, bins]")
    histograms = PhotonHistograms(photons.sendable(counts), stamp_ns)
    of_bins = {} if options.get("histograms") is not None else {"num_bins": counts.shape[2]}
    sensor, assumed = _sensor(sensor, options, {"shape": counts.shape[:2]} | of_bins)
    try:
        histograms.check(sensor)
    except InvalidInput as error:
        field = error.field.removesuffix(" count").replace("histograms", "counts")      # as the argument is called
        raise InvalidInput(field, error.value, error.expected) from None
    return _complete(histograms, sensor, assumed)


def completed(source: Photons | PhotonStream | PhotonFrame, sensor: SensorModel | None, options: SensorOptions
              ) -> Photons | PhotonStream:
    """Photons of a file, or a frame of photons, with the sensor and the options instead of their own."""
    if isinstance(source, Photons | PhotonStream):
        return source.with_sensor(described(sensor or source.sensor, options))
    sensor, assumed = _sensor(sensor, options, {})
    source.check(sensor)
    frame = source.to_events(sensor) if isinstance(source, PhotonGates) else source
    return _complete(frame, sensor, assumed)


def described(sensor: SensorModel, options: Mapping[str, Any]) -> SensorModel:
    """The sensor with the options in place of its own values.

    Raises:
        InvalidInput: an unknown option, or a value that cannot be used.
    """
    given: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
    for name in given:
        require(name in OPTIONS, "option", name, f"one of {', '.join(OPTIONS)}")
    require(isinstance(sensor, SensorModel), "sensor", type(sensor).__name__, "a Sensor")
    own = sensor.rows, sensor.cols
    require(_shape(given.pop("shape", own)) == own, "shape", options.get("shape"), f"{own}, as the sensor has")
    require(not {"fov_deg", "projection"} <= given.keys(), "fov_deg", options.get("fov_deg"),
            "fov_deg or projection, not both")
    for name in ("gain", "delay_bins", "mask", "background_shape", "irf"):
        if name in given and not isinstance(given[name], (str, Path)):
            given[name] = _array(name, given[name])
    if "irf" in given:
        given["irf"] = irfs.read(given["irf"])
    return photons.described(sensor, given)


def _sensor(sensor: SensorModel | None, options: SensorOptions, counted: dict) -> tuple[SensorModel, set[str]]:
    """The sensor that is given or described, and which of irf and fov_deg nobody said.

    Args:
        counted: the options that the photons themselves tell.
    """
    if sensor is not None:
        return described(sensor, options), set()
    given: dict[str, Any] = counted | {name: value for name, value in options.items() if value is not None}
    for name, expected in (("shape", "(rows, cols), or sensor"), ("num_bins", "T, bins of a laser period, or sensor"),
                           ("bin_width_s", NO_BIN_WIDTH)):
        require(name in given, name, "missing", expected)
    require("irf" in given or "irf_ref" not in given, "irf_ref", given.get("irf_ref"), "irf beside it")
    plain = SensorModel(*_shape(given["shape"]), given["num_bins"], given["bin_width_s"], np.ones(1))
    said = given.keys() | ({"fov_deg"} if "projection" in given else set())
    return described(plain, given), {"irf", "fov_deg"} - said


def _complete(frame: PhotonEvents | PhotonHistograms, sensor: SensorModel, assumed: set[str]) -> Photons:
    """The photons of a sensor, with notes on what was assumed of it."""
    notes = (ASSUMED_FOV,) if "fov_deg" in assumed else ()
    if "irf" in assumed:
        sensor, notes = sensor.replace(irf=_estimated_irf(frame, sensor), irf_ref=None), (ESTIMATED_IRF, *notes)
    return Photons(sensor, frame, None, NAME, notes)


def _estimated_irf(frame: PhotonEvents | PhotonHistograms, sensor: SensorModel) -> np.ndarray:
    """The IRF that the photons show, see `irf.estimate`."""
    if isinstance(frame, PhotonHistograms):
        require(sensor.histograms is None, "irf", "missing", "the impulse response, as wide as these bins make it")
        survey = Survey(sensor.pixels, sensor.num_bins)
        survey.add_histograms(frame.counts.reshape(sensor.pixels, -1), 0)
        require(survey.countable, "irf", "missing", "the impulse response: it can be estimated from whole photons only")
        frame = survey.sample
    return irfs.estimate(frame if sensor.mask is None else frame.part(sensor.mask.reshape(-1)[frame.pixel]),
                         sensor.num_bins)


def _array(name: str, values: Any) -> np.ndarray:
    """Values as a NumPy array; a tensor is copied from its device."""
    try:
        array = np.asarray(values.detach().cpu() if hasattr(values, "detach") else values)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidInput(name, f"{type(values).__name__} ({error})", "an array of numbers") from None
    require(array.dtype.kind in "biuf", f"{name} dtype", str(array.dtype), "numbers")
    return array


def _shape(shape: Any) -> tuple[int, int]:
    try:
        rows, cols = shape
    except (TypeError, ValueError):
        raise InvalidInput("shape", shape, "(rows, cols)") from None
    return rows, cols


def _indices(name: str, values: np.ndarray, end: int) -> np.ndarray:
    """Whole numbers from 0 to below `end`, as uint32."""
    photons.check_within(name, values, end)
    whole = values.astype(np.uint32)
    odd = np.flatnonzero(whole != values)
    require(len(odd) == 0, name, values[odd[:1]].tolist(), "whole numbers")
    return whole


def _times(toa: np.ndarray, sensor: SensorModel) -> np.ndarray:
    """ToA in bins, uint16 or float32."""
    photons.check_within("toa", toa, sensor.num_bins)
    if toa.dtype.kind != "f":
        return toa.astype(np.uint16)
    if sensor.first_bin_center == 0 and (toa == np.floor(toa)).all():       # means the same, and is faster to sketch
        return toa.astype(np.uint16)
    return np.minimum(toa.astype(np.float32), np.nextafter(np.float32(sensor.num_bins), np.float32(0)))
