"""Arrays in memory → a frame of photons and its sensor: row, col and ToA of each photon, or counts."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonFrame, PhotonGates, PhotonHistograms
from srt3d_ros.datasets import irf as irfs
from srt3d_ros.datasets.options import (
    ASSUMED_FOV,
    ASSUMED_WIDTH,
    BIN_OF_ONE_METRE_S,
    described,
    few_bins_note,
    refuse_channel,
    says_geometry,
)
from srt3d_ros.datasets.values import array, check_within, sendable
from srt3d_ros.errors import InvalidInput, quoted, require

MAX_KEPT = 2**24            # photons of a sample, 100 MB; of files, fewer become events
Described = tuple[SensorModel, PhotonEvents | PhotonHistograms, tuple[str, ...]]     # and notes


def from_events(row: Any, col: Any, toa: Any, stamp_ns: int, options: dict) -> Described:
    """The photons of one entry each; arguments as of `Photons.from_events`, options of `gathered`."""
    row, col, toa = (array(name, values) for name, values in (("row", row), ("col", col), ("toa", toa)))
    fits = row.ndim == 1 and row.shape == col.shape == toa.shape
    require(fits, "row, col and toa shapes", f"{row.shape}, {col.shape}, {toa.shape}", "the same [N], one a photon")
    require(isinstance(stamp_ns, int | np.integer), "stamp_ns", quoted(stamp_ns), "nanoseconds, an integer")
    sensor, notes = sensor_of(options)
    pixel = _indices("row", row, sensor.rows) * np.uint32(sensor.cols) + _indices("col", col, sensor.cols)
    return complete(PhotonEvents(pixel, _times(toa, sensor), stamp_ns), sensor, options, notes)


def from_pixels(pixel: np.ndarray, toa: np.ndarray, stamp_ns: int, options: dict) -> Described:
    """The photons of one entry each, by the index of their pixel."""
    sensor, notes = sensor_of(options)
    events = PhotonEvents(_indices("pixel", pixel, sensor.pixels), _times(toa, sensor), stamp_ns)
    return complete(events, sensor, options, notes)


def from_counts(counts: Any, stamp_ns: int, options: dict) -> Described:
    """The photons of histograms; arguments as of `Photons.from_counts`, options of `gathered`."""
    counts = array("counts", counts)
    require(counts.ndim == 3, "counts", f"{counts.dtype} {counts.shape}", "numbers [rows, cols, bins]")
    histograms = PhotonHistograms(np.ascontiguousarray(sendable(counts)), stamp_ns)
    sizes = dict(zip(("rows", "cols", "num_bins"), counts.shape))
    if options.get("histograms") is not None:
        del sizes["num_bins"]
    sensor, notes = sensor_of(sizes | options)
    try:
        histograms.check(sensor)
    except InvalidInput as error:
        field = error.field.removesuffix(" count").replace("histograms", "counts")      # as the argument is called
        raise InvalidInput(field, error.value, error.expected, error.problem) from None
    return complete(histograms, sensor, options, notes + few_bins_note(counts.shape))


def from_frame(frame: PhotonFrame, options: dict) -> Described:
    """A frame of photons; gates become events."""
    sensor, notes = sensor_of(options)
    frame.check(sensor)
    if isinstance(frame, PhotonGates):
        sensor, frame = frame.counted(sensor), frame.to_events(sensor)
    return complete(frame, sensor, options, notes)


def sensor_of(options: Mapping[str, Any]) -> tuple[SensorModel, tuple[str, ...]]:
    """The sensor that the options describe, with an IRF of one bin if they have none; and a note on its bin width."""
    for name, expected in (("rows", "(rows, cols), or sensor"), ("cols", "(rows, cols), or sensor"),
                           ("num_bins", "T, bins of a laser period, or sensor")):
        require(name in options, "shape" if name != "num_bins" else name, "missing", expected)
    refuse_channel(options)
    require("irf" in options or "irf_ref" not in options, "irf_ref", options.get("irf_ref"), "irf beside it")
    width_s = options.get("bin_width_s", BIN_OF_ONE_METRE_S)
    plain = SensorModel(options["rows"], options["cols"], options["num_bins"], width_s, np.ones(1))
    return described(plain, options), () if "bin_width_s" in options else (ASSUMED_WIDTH,)


def complete(frame: PhotonEvents | PhotonHistograms, sensor: SensorModel, options: Mapping[str, Any],
             notes: tuple[str, ...]) -> Described:
    """The frame and its sensor with, if the options have none, the IRF that the photons show (`irf.estimate`)."""
    if "irf" not in options:
        require(sensor.histograms is None, "irf", "missing", "the impulse response, as wide as these bins make it")
        sample = sampled(frame.counts) if isinstance(frame, PhotonHistograms) else frame
        seen = sample if sensor.mask is None else sample.part(sensor.mask.reshape(-1)[sample.pixel])
        irf, note = irfs.estimated(seen, sensor.num_bins, options.get("guess_irf", False))
        sensor, notes = sensor.replace(irf=irf, irf_ref=None), (*notes, note)
    return sensor, frame, notes if says_geometry(options) else (*notes, ASSUMED_FOV)


def are_whole(counts: np.ndarray) -> bool:
    """Whether counts [rows, cols, bins] are whole photons."""
    return counts.dtype.kind in "ub" or all((row >= 0).all() and (row == np.floor(row)).all() for row in counts)


def sampled(counts: np.ndarray) -> PhotonEvents:
    """The photons of every n-th pixel of counts [rows, cols, bins], n the power of two for at most MAX_KEPT of them.

    Of a single pixel with more some of them; negative counts are none.
    """
    photons = np.concatenate([np.maximum(row, 0).sum(axis=1, dtype=np.float64) for row in counts])
    step, counts = 1, counts.reshape(len(photons), -1)
    while (most := photons[::step].sum()) > MAX_KEPT and step < len(photons):
        step *= 2
    counts = counts[::step] if most <= MAX_KEPT else np.floor(counts[::step] * (MAX_KEPT / most))
    pixel, toa = np.nonzero(counts)
    times = np.rint(np.maximum(counts[pixel, toa], 0)).astype(np.int64)
    return PhotonEvents((step * pixel).astype(np.uint32).repeat(times), toa.astype(np.uint16).repeat(times))


def _indices(name: str, values: np.ndarray, end: int) -> np.ndarray:
    """Whole numbers from 0 to below `end`, as uint32."""
    check_within(name, values, end)
    whole = values.astype(np.uint32, copy=False)
    odd = np.flatnonzero(whole != values)
    require(len(odd) == 0, name, values[odd[:1]].tolist(), "whole numbers")
    return whole


def _times(toa: np.ndarray, sensor: SensorModel) -> np.ndarray:
    """ToA in bins, uint16 or float32."""
    check_within("toa", toa, sensor.num_bins)
    if toa.dtype.kind != "f":
        return toa.astype(np.uint16, copy=False)
    in_seconds = toa.size > 1 and toa.max() < 1 and toa.any()
    require(not in_seconds, "toa", "below 1 everywhere", "times in bins: divide seconds by bin_width_s")
    if (toa == np.floor(toa)).all():        # means the same, and is faster to sketch
        return toa.astype(np.uint16)
    return np.minimum(toa.astype(np.float32), np.nextafter(np.float32(sensor.num_bins), np.float32(0)))
