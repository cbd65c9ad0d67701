"""Turn arrays in memory (row, col and ToA of each photon, or counts) into a frame of photons and its sensor."""

from dataclasses import replace
from typing import Any

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching import plausibility
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonFrame, PhotonGates, PhotonHistograms
from srt3d_ros.datasets import axes
from srt3d_ros.datasets import irf as irfs
from srt3d_ros.datasets.options import (
    ASSUMED_FOV,
    ASSUMED_WIDTH,
    BIN_OF_ONE_METRE_S,
    HALF_BIN_M,
    Options,
    described,
    says_geometry,
)
from srt3d_ros.datasets.values import Note, array, sendable
from srt3d_ros.errors import InvalidInput, quoted, require

SUBTRACTED = "cycles not used, pile-up not corrected: some counts are negative, so something was subtracted"
MAX_KEPT = 2**24            # photons in a sample, 100 MB; files with fewer become events
Described = tuple[SensorModel, PhotonEvents | PhotonHistograms, tuple[str, ...]]     # and notes


def from_events(row: Any, col: Any, toa: Any, stamp_ns: int, options: Options) -> Described:
    """Photons with one entry each; arguments as for `Photons.from_events`, options from `gathered`."""
    row, col, toa = array("row", row), array("col", col), array("toa", toa)
    fits = row.ndim == 1 and row.shape == col.shape == toa.shape
    require(fits, "row, col and toa shapes", f"{row.shape}, {col.shape}, {toa.shape}", "one entry a photon in each")
    require(isinstance(stamp_ns, int | np.integer), "stamp_ns", quoted(stamp_ns), "nanoseconds, an integer")
    sensor, notes = sensor_of(options)
    pixel = _indices("row", row, sensor.rows) * np.uint32(sensor.cols) + _indices("col", col, sensor.cols)
    pixel, toa, stray = without_strays(pixel, toa, sensor.num_bins)
    return complete(PhotonEvents(pixel, _times(toa, sensor), stamp_ns), sensor, options, notes + stray)


def from_pixels(pixel: np.ndarray, toa: np.ndarray, stamp_ns: int, options: Options) -> Described:
    """Photons with one entry each, by the index of their pixel."""
    sensor, notes = sensor_of(options)
    require(pixel.ndim == 1 and pixel.shape == toa.shape, "pixel and toa shapes", f"{pixel.shape} and {toa.shape}",
            "the same [N]")
    pixel, toa, stray = without_strays(_indices("pixel", pixel, sensor.pixels), toa, sensor.num_bins)
    return complete(PhotonEvents(pixel, _times(toa, sensor), stamp_ns), sensor, options, notes + stray)


def without_strays(pixel: np.ndarray, toa: np.ndarray, num_bins: int
                   ) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Drop the photons whose ToA is not in 0 ≤ toa < T; pixel and ToA of the others, and a note if there were any.

    Raises:
        InvalidInput: most photons would be dropped.
    """
    if not toa.size or (0 <= toa.min() and toa.max() < num_bins):     # a NaN makes both NaN
        return pixel, toa, ()
    inside = (toa >= 0) & (toa < num_bins)
    kept = int(np.count_nonzero(inside))
    stray = f"{len(toa) - kept:,} of {len(toa):,} photons lie outside 0 to below {num_bins} bins"
    require(2 * kept >= len(toa), "toa", problem=f"{stray}: num_bins is probably wrong, or toa counts no bins.")
    return pixel[inside], toa[inside], (f"{stray}: dropped",)


def fitted(frame: PhotonFrame, sensor: SensorModel) -> tuple[PhotonFrame, tuple[str, ...]]:
    """The frame `without_strays` and the note on them; InvalidInput if it does not fit the sensor otherwise."""
    notes = ()
    if isinstance(frame, PhotonEvents):
        pixel, toa, notes = without_strays(frame.pixel, frame.toa, sensor.num_bins)
        frame = replace(frame, pixel=pixel, toa=toa) if notes else frame
    frame.check(sensor)
    return frame, notes


def from_counts(counts: Any, stamp_ns: int, options: Options) -> Described:
    """Photons counted in bins; arguments as for `Photons.from_counts`, options from `gathered`."""
    dims, counts = getattr(counts, "dims", ()), array("counts", counts)
    dims = tuple(map(str, dims)) if isinstance(dims, tuple) else ()
    given = f"{counts.dtype} {counts.shape}"
    counts, options, few_bins, frames = axes.in_order(counts, options, {}, dims)
    require(counts.ndim == 3 and frames == 1, "counts", given, "numbers [rows, cols, bins] of one frame")
    histograms = PhotonHistograms(np.ascontiguousarray(sendable(counts)), stamp_ns)
    sizes = dict(zip(("rows", "cols", "num_bins"), counts.shape))
    if options.known.get("histograms") is not None:
        del sizes["num_bins"]
    options = replace(options, known=sizes | options.known)
    sensor, notes = sensor_of(options)
    try:
        histograms.check(sensor)
    except InvalidInput as error:
        field = error.field.removesuffix(" count").replace("histograms", "counts")      # the name of the argument
        raise InvalidInput(field, error.value, error.expected, error.problem) from None
    return complete(histograms, sensor, options, notes + few_bins)


def from_frame(frame: PhotonFrame, options: Options) -> Described:
    """A frame of photons; gates become events."""
    sensor, notes = sensor_of(options)
    frame, stray = fitted(frame, sensor)
    if isinstance(frame, PhotonGates):
        sensor, frame = frame.counted(sensor), frame.to_events(sensor)
    return complete(frame, sensor, options, notes + stray)


def sensor_of(options: Options) -> tuple[SensorModel, tuple[str, ...]]:
    """The sensor that the options describe, with an IRF of one bin if they have none; and notes on it."""
    known = options.known
    options.refuse_unfollowed()
    require({"rows", "cols"} <= known.keys(), "shape", problem="Give shape=(rows, cols), or sensor.")
    require("num_bins" in known, "num_bins", problem="Give num_bins, the bins of a laser period, or sensor.")
    require("irf" in known or "irf_ref" not in known, "irf_ref", problem="irf_ref needs irf.")
    width_s = known.get("bin_width_s", BIN_OF_ONE_METRE_S)
    plain = SensorModel(known["rows"], known["cols"], known["num_bins"], width_s, np.ones(1))
    sensor, notes = described(plain, known)
    return sensor, notes if "bin_width_s" in known else (ASSUMED_WIDTH, *notes)


def complete(frame: PhotonEvents | PhotonHistograms, sensor: SensorModel, options: Options,
             notes: tuple[str, ...]) -> Described:
    """The sensor and frame, the IRF estimated from the photons if the options have none; and all notes.

    Raises:
        InvalidInput: the IRF cannot be estimated, or no count is positive and some are negative.
    """
    if isinstance(frame, PhotonHistograms) and not frame.photons and frame.counts.size:
        low, high = frame.counts.min(), frame.counts.max()
        require(high > 0 or low == 0, "counts", problem="No count is above 0. If the signal is inverted, negate it.")
        if low < 0:
            notes += ("negative counts outweigh the positive ones: was too much background subtracted?",)
    if isinstance(frame, PhotonHistograms) and sensor.cycles and frame.has_negative:
        notes += (SUBTRACTED,)
    sensor, hot, more = looked_through(frame, plausibility.light_of(frame, sensor), sensor, options)
    notes += more
    if "irf" not in options.known:
        require(sensor.histograms is None, "irf", problem="Give irf, widened by these bins: histograms cannot show it.")
        sample = sampled(frame.counts) if isinstance(frame, PhotonHistograms) else frame
        irf, note = irfs.estimated(sample.part((sensor.used & ~hot).reshape(-1)[sample.pixel]), sensor.num_bins,
                                   options.guess_irf)
        sensor, notes = sensor.replace(irf=irf, irf_ref=None), (*notes, note)
    half_m, known = 0.5 * sensor.bin_width_m, options.known
    whole = isinstance(frame, PhotonHistograms) or frame.toa.dtype.kind == "u"
    says_zero = {"toa_offset_bins", "range_offset_m"} & {*known} or "bin_width_s" not in known
    if whole and half_m > HALF_BIN_M and not says_zero:
        notes += Note(f"ranges are {half_m * 1e3:.3g} mm short if the clock truncates: toa_offset_bins is then 0.5 "
                      "(--toa-offset-bins)", "toa_offset_bins"),
    return sensor, frame, notes if says_geometry(known) else (*notes, ASSUMED_FOV)


def looked_through(frame: PhotonFrame, light: plausibility.Light, sensor: SensorModel, options: Options
                   ) -> tuple[SensorModel, np.ndarray, tuple[str, ...]]:
    """The sensor, hot pixels masked unless options say otherwise; where they are; and notes on what looks wrong."""
    hot = plausibility.hot_pixels(light, sensor)
    notes = [Note(plausibility.leak(light), "gate")]
    if isinstance(frame, PhotonEvents):
        notes.append(plausibility.other_unit(frame, sensor))
    if hot.any():
        said = f"{np.count_nonzero(hot):,} hot pixels of {hot.size:,}: far brighter than those around, without signal"
        if options.mask_hot or (options.mask_hot is None and "mask" not in options.known):
            sensor = sensor.replace(mask=sensor.used & ~hot)
            notes.append(Note(f"{said}; left out (mask=off keeps them)", "mask"))
        else:
            notes.append(f"{said}; mask=auto (--mask auto) leaves them out")
    return sensor, hot, tuple(filter(None, notes))


def are_whole(counts: np.ndarray) -> bool:
    """Whether counts [rows, cols, bins] are whole photons."""
    return counts.dtype.kind in "ub" or all((row >= 0).all() and (row == np.floor(row)).all() for row in counts)


def sampled(counts: np.ndarray) -> PhotonEvents:
    """The photons of every n-th pixel of counts [rows, cols, bins], n the power of two that leaves at most MAX_KEPT.

    A single pixel with more keeps MAX_KEPT of them. Negative counts become 0.
    """
    photons = np.concatenate([np.maximum(row, 0).sum(axis=1, dtype=np.float64) for row in counts])
    step = 1
    while (kept := photons[::step].sum()) > MAX_KEPT and step < len(photons):
        step *= 2
    sample = counts.reshape(len(photons), -1)[::step]
    if kept > MAX_KEPT:
        sample = np.floor(sample * (MAX_KEPT / kept))
    pixel, toa = np.nonzero(sample)
    times = np.rint(np.maximum(sample[pixel, toa], 0)).astype(np.int64)
    return PhotonEvents((step * pixel).astype(np.uint32).repeat(times), toa.astype(np.uint16).repeat(times))


def _indices(name: str, values: np.ndarray, end: int) -> np.ndarray:
    """Whole numbers from 0 to below `end`, as uint32; InvalidInput if others."""
    if values.size:
        low, high = values.min().item(), values.max().item()        # a NaN makes both NaN
        require(0 <= low and high < end, name, low if high < end else high, f"0 to below {end}")
    whole = values.astype(np.uint32, copy=False)
    fractional = values[whole != values]
    require(len(fractional) == 0, name, fractional[:1].tolist(), "whole numbers")
    return whole


def _times(toa: np.ndarray, sensor: SensorModel) -> np.ndarray:
    """ToA inside the sensor's bins as uint16 or float32; InvalidInput if they are seconds."""
    if toa.dtype.kind != "f":
        return toa.astype(np.uint16, copy=False)
    in_seconds = toa.size > 1 and toa.max() < 1 and toa.any()
    require(not in_seconds, "toa", problem="All toa are below 1. They count bins: divide seconds by bin_width_s.")
    if (toa == np.floor(toa)).all():        # integers are faster to sketch
        return toa.astype(np.uint16)
    return sensor.toa_within(toa)
