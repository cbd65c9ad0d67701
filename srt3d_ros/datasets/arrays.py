"""Turn arrays in memory (row, col and ToA of each photon, or counts) into a frame of photons and its sensor."""

from dataclasses import replace
from typing import Any

import numpy as np

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import MAX_BINS, SensorModel
from srt3d_ros.core.sketching import plausibility
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonFrame, PhotonGates, PhotonHistograms
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.datasets import axes
from srt3d_ros.datasets import irf as irfs
from srt3d_ros.datasets.axes import SIZES
from srt3d_ros.datasets.options import ASSUMED_FOV, HALF_BIN_M, Options, fields_of, sensor_of
from srt3d_ros.datasets.reading import Reading, Said, in_gate
from srt3d_ros.datasets.values import Note, array, outside_note, sendable
from srt3d_ros.errors import finite, quoted, require

SUBTRACTED = "cycles not used, pile-up not corrected: some counts are negative, so something was subtracted"
MAX_KEPT = 2**24            # photons in a sample, 100 MB; files with fewer become events


def from_photons(columns: tuple[Any, ...], options: Options, said: Said) -> Reading:
    """Photons with one entry each: `columns` are [N] of row, column and ToA, or of pixel index and ToA."""
    names = ("row", "col", "toa") if len(columns) == 3 else ("pixel", "toa")
    *places, toa = (array(column, values) for column, values in zip(names, columns))
    require(toa.ndim == 1 and all(place.shape == toa.shape for place in places),
            f"{', '.join(names[:-1])} and toa shapes", ", ".join(str(one.shape) for one in (*places, toa)),
            "one entry a photon in each")
    require(isinstance(said.stamp_ns, int | np.integer), "stamp_ns", quoted(said.stamp_ns), "nanoseconds, an integer")
    sensor, options, notes = sensor_of(options, said.sensor, said.notes)
    sides = (sensor.rows, sensor.cols) if len(places) == 2 else (sensor.pixels,)
    row, *col = (_indices(place, values, side) for place, values, side in zip(names, places, sides))
    pixel = row * np.uint32(sensor.cols) + col[0] if col else row
    pixel, toa, stray = without_strays(pixel, toa, sensor.num_bins)
    return _reading(PhotonEvents(pixel, _times(toa, sensor), said.stamp_ns), sensor, options, said, notes + stray)


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


def from_counts(counts: Any, options: Options, said: Said, dims: tuple[str, ...] = (), in_file: bool = True
                ) -> Reading:
    """Photons counted in bins. Large counts stay in their file.

    Args:
        counts: of three or four axes; options, sizes that the file has said, or `dims`, names of its axes, order them.
        in_file: few whole counts then become events, and there may be several frames.
    """
    given, dims = array("counts", counts), dims or getattr(counts, "dims", ())
    dims = tuple(map(str, dims)) if isinstance(dims, tuple) else ()
    counts, options, order, frames = axes.in_order(given, options, said.sensor, dims)
    require(counts.ndim == 3 and counts.size > 0 and (in_file or frames == 1), "counts",
            f"{given.dtype} {given.shape}", "numbers [rows, cols, bins] of one frame")
    options, notes = options.over(said.sensor | dict(zip(SIZES[:2], counts.shape)), (*said.notes, *order))
    bins = counts.shape[2]
    first, last = 0, bins - 1
    if options.known.get("histograms") is None:
        period = int(finite("num_bins", options.known.get("num_bins", bins), "a number of bins"))
        require(bins <= MAX_BINS or options.gate, "counts bins", bins, f"at most {MAX_BINS}; or give a gate")
        first, last = options.gate or (0, period - 1)
        require(1 <= last - first < MAX_BINS, "num_bins", last - first + 1,
                f"2 to {MAX_BINS}: give num_bins, gate or bin_width_s")
        options = options.knowing(num_bins=last - first + 1).without("gate")
    sensor, options, assumed = sensor_of(options)
    photons = counts.sum(dtype=np.float64)
    require(np.isfinite(photons), "counts", problem="counts holds infinite numbers or NaN.")
    kept = sendable(counts[..., first:last + 1])
    if photons <= 0 and kept.size:
        low, high = kept.min(), kept.max()
        require(high > 0 or low == 0, "counts", problem="No count is above 0. If the signal is inverted, negate it.")
        if low < 0:
            notes += ("negative counts outweigh the positive ones: was too much background subtracted?",)
    notes += scaled_note(kept)
    missing, inside = last - first + 1 - kept.shape[2], kept.sum(dtype=np.float64)
    kept = np.ascontiguousarray(np.pad(kept, ((0, 0), (0, 0), (0, missing))) if missing else kept)
    frame = PhotonHistograms(kept, said.stamp_ns)
    frame.check(sensor)
    if in_file and sensor.histograms is None and inside <= MAX_KEPT and are_whole(kept):
        frame = replace(sampled(kept), stamp_ns=said.stamp_ns)
    said = replace(said, reference_depth_bins=in_gate(said.reference_depth_bins, first, last))
    reading = _reading(frame, sensor, options, said, notes + assumed)
    notes = reading.notes + outside_note(round(photons - inside), round(photons), first, last)
    sensor = reading.sensor.replace(toa_offset_bins=reading.sensor.toa_offset_bins + first)
    return replace(reading, sensor=sensor, frames=frames, notes=notes)


def scaled_note(counts: np.ndarray) -> tuple[str, ...]:
    """A note on counts that are all multiples of one number, but not of 1, in the first row with enough of them."""
    rows = (row[row > 0] for row in counts)
    values = next((row.astype(np.float64) for row in rows if len(row) >= plausibility.ENOUGH), np.ones(1))
    steps = values / values.min()
    if values.min() in (1, values.max()) or np.abs(steps - np.rint(steps)).max() > 1e-3:
        return ()
    return (f"counts are multiples of {values.min():.4g}: if they were scaled, divide them by it; from too many "
            "photons come false points",)


def from_frame(frame: PhotonFrame, options: Options, said: Said) -> Reading:
    """A frame of photons with its own stamp; gates become events."""
    sensor, options, notes = sensor_of(options, said.sensor, said.notes)
    if isinstance(frame, PhotonEvents):
        pixel, toa, stray = without_strays(frame.pixel, frame.toa, sensor.num_bins)
        frame, notes = replace(frame, pixel=pixel, toa=toa), notes + stray
    frame.check(sensor)
    if isinstance(frame, PhotonGates):
        sensor, frame = frame.counted(sensor), frame.to_events(sensor)
    return _reading(frame, sensor, options, said, notes)


def with_options(reading: Reading, options: Options) -> Reading:
    """The same frame with options in place of its sensor's values; a note lists them.

    Raises:
        InvalidInput: the options would have made another sketch, or there are any for a cloud.
    """
    if options == Options():
        return reading
    require(not isinstance(reading.frame, PointCloud), reading.name,
            problem=f"{reading.name} holds a cloud: no option can change it.")
    own = fields_of(reading.sensor)
    if not isinstance(reading.frame, PhaseSums):
        return from_frame(reading.frame, options, Said(own, reading.notes, reading.name, reading.reference_depth_bins))
    require(options.gate is None, "gate", problem="A sketch cannot be gated: gate the photons.")
    sensor, _, notes = sensor_of(options, own, reading.notes, SIZES)
    sums = replace(reading.frame, sensor=sensor, cycles=reading.frame.cycles or sensor.cycles or 0)
    return replace(reading, sensor=sensor, frame=sums, notes=notes)


def _reading(frame: PhotonEvents | PhotonHistograms, sensor: SensorModel, options: Options, said: Said,
             notes: tuple[str, ...]) -> Reading:
    """A frame that fits its sensor, without hot pixels, gated, the IRF estimated if the options have none; all notes.

    Raises:
        InvalidInput: the IRF cannot be estimated.
    """
    known, depth = options.known, said.reference_depth_bins
    require(depth is None or depth.shape[1:] == (sensor.rows, sensor.cols), "ref_depth_bins shape",
            np.shape(depth), f"[rows, cols] = {(sensor.rows, sensor.cols)}")
    if isinstance(frame, PhotonHistograms) and sensor.cycles and frame.has_negative:
        notes += (SUBTRACTED,)
    sensor, hot, more = _looked_through(frame, sensor, options)
    notes += more
    if "irf" not in known:
        require(sensor.histograms is None, "irf", problem="Give irf, widened by these bins: histograms cannot show it.")
        sample = sampled(frame.counts) if isinstance(frame, PhotonHistograms) else frame
        irf, note = irfs.estimated(sample.part((sensor.used & ~hot).reshape(-1)[sample.pixel]), sensor.num_bins,
                                   options.guess_irf)
        sensor, notes = sensor.replace(irf=irf, irf_ref=None), (*notes, note)
    half_m = 0.5 * sensor.bin_width_m
    whole = isinstance(frame, PhotonHistograms) or frame.toa.dtype.kind == "u"
    says_zero = {"toa_offset_bins", "range_offset_m"} & {*known} or "bin_width_s" not in known
    if whole and half_m > HALF_BIN_M and not says_zero:
        notes += Note(f"ranges are {half_m * 1e3:.3g} mm short if the clock truncates: toa_offset_bins is then 0.5 "
                      "(--toa-offset-bins)", "toa_offset_bins"),
    notes += () if "projection" in known else (ASSUMED_FOV,)
    reading = Reading(sensor, frame, depth, said.name, tuple(dict.fromkeys(notes)))
    return reading.gated(*options.gate) if options.gate else reading


def _looked_through(frame: PhotonEvents | PhotonHistograms, sensor: SensorModel, options: Options
                    ) -> tuple[SensorModel, np.ndarray, tuple[str, ...]]:
    """The sensor, hot pixels masked unless options say otherwise; where they are; and notes on what looks wrong."""
    light = plausibility.light_of(frame, sensor)
    hot, notes = plausibility.hot_pixels(light, sensor), [Note(plausibility.leak(light), "gate")]
    if isinstance(frame, PhotonEvents):
        notes.append(plausibility.other_unit(frame, sensor))
    if hot.any():
        said = f"{np.count_nonzero(hot):,} hot pixels of {hot.size:,}: far brighter than those around, without signal"
        if options.mask_hot or (options.mask_hot is None and "mask" not in options.known):
            sensor = sensor.replace(mask=sensor.used & ~hot)
            notes.append(Note(f"{said}; left out (mask=off keeps them)", "mask"))
        else:
            notes.append(Note(f"{said}; mask=auto (--mask auto) leaves them out", "mask"))
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
