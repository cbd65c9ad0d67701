"""Read PicoQuant .ptu files in T2 mode: every event has a time, also the laser's pulses on the sync channel."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from srt3d_ros.core.sensor.model import MAX_BINS
from srt3d_ros.datasets.named_arrays import Content
from srt3d_ros.datasets.options import Options
from srt3d_ros.datasets.values import channel_of
from srt3d_ros.errors import finite, require

RECORDS = 2**20                 # decoded at once
PICOHARP = 0x00010203           # its input 0 is the sync channel; later devices mark it by the highest bit of a record
HIGHEST_BIT = 31
MARKS = {"ImgHdr_LineStart", "ImgHdr_LineStop", "ImgHdr_Frame"}


def read(ptu: Any, options: Options) -> Content:
    """Photons of an open T2 file, of `channel` or the channel with the most, since the newest pulse; one pixel."""
    tick_s = ptu.global_resolution
    require(0 < tick_s < 1, "MeasDesc_GlobalResolution", tick_s, "seconds of a tick")
    period = _period(ptu)
    width_s = options.known.get("bin_width_s", np.ceil(period / MAX_BINS) * tick_s)
    width_s = finite("bin_width_s", width_s, "seconds, above 0")
    bins = int(np.ceil(period * tick_s / width_s - 1e-3)) if width_s > 0 else 0
    require(2 <= bins <= MAX_BINS, "bin_width_s", width_s,
            f"2 to {MAX_BINS} bins in the laser's {period * tick_s:.3g} s")
    counts = np.zeros(ptu.number_channels_max * bins, np.int64)
    newest = -1
    for time, channel, is_sync in _events(ptu):
        pulses = np.append(newest, time[is_sync])
        pulse, newest = pulses[np.cumsum(is_sync)], pulses[-1]
        use = (channel >= 0) & ~is_sync & (pulse >= 0)          # none before the first pulse
        toa = np.rint((time - pulse)[use] % period * (tick_s / width_s)).astype(np.int64) % bins
        counts += np.bincount(channel[use].astype(np.int64) * bins + toa, minlength=len(counts))
    counts = counts.reshape(-1, bins)
    photons = {number: total for number, total in enumerate(counts.sum(axis=1)) if total}
    chosen, notes = channel_of(photons, options.channel)
    notes += (f"T2: ToA since the pulses on the sync channel, {period * tick_s * 1e9:.6g} ns apart, all in one pixel",)
    if not MARKS.isdisjoint(ptu.tags):
        notes += ("the markers of its scan are not read: record T3",)
    arrays = {"counts": counts[None, chosen, None], "bin_width_s": width_s, "num_bins": bins,
              "toa_offset_bins": 0.0}       # rounded, not truncated
    return Content(arrays, options.without("channel"), notes)


def _period(ptu: Any) -> float:
    """Ticks between two pulses of the laser, of which every n-th may have been recorded."""
    pulses = np.concatenate([time[is_sync] for (time, _, is_sync), _ in zip(_events(ptu), range(4))])
    require(len(pulses) > 1, "sync channel", f"{len(pulses)} events",
            "the laser's pulses, which T2 counts ToA from: connect them to the sync input, or record T3")
    return max(float(np.median(np.diff(pulses))) / max(int(ptu.tags.get("HWSync_Divider", 1)), 1), 1.0)


def _events(ptu: Any) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Time in ticks, channel (-1: none) and whether it is a pulse of the laser, of all records, in parts."""
    records, carried = ptu.read_records(memmap=True), 0
    for first in range(0, len(records), RECORDS):
        raw = np.append(records[first:first + RECORDS], np.uint32(0))      # a record at tick 0 has all overflows
        decoded = ptu.decode_records(raw)
        channel, time = decoded["channel"][:-1], decoded["time"].astype(np.int64) + carried
        marked = raw[:-1] >> HIGHEST_BIT == 1
        yield time[:-1], channel, (channel == 0) & (marked | (ptu.record_type == PICOHARP))
        carried = time[-1]
