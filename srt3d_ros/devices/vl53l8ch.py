"""ST VL53L8CH and VL53L7CH: "compact normalised histograms" (CNH), as two programs log them.

* CSV of ST's MZ-AI evaluation program: a line a frame, columns cnh__hist_bin_B_aZ for bin B of aggregate Z.
* Text of the Arduino library's example VL53L8CH_CNHData, a line an aggregate: "Aggregate Z, Ambient: …, Bins: …, …".

From the sources https://github.com/davideq/VL53L8CH, https://github.com/stm32duino/VL53L7CH (vl53lmz_plugin_cnh) and
https://github.com/gavinlloyd1/UR5e-VL53L8CH only; without a device or a log of one nothing is verified. Neither log
tells start bin and sub-sampling: bins are taken for the sensor's own, from bin 0 on; a sidecar LOG.json corrects
`bin_width_s` (sub-sampling times 250.4 ps) and `toa_offset_bins` (start bin over sub-sampling). The sensor takes
ambient light and crosstalk off its histograms, so that counts may be negative. It sends no reference pulse.
"""

import csv
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from srt3d_ros.core.photons import PhotonHistograms
from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import SPEED_OF_LIGHT, SensorModel
from srt3d_ros.devices.reading import Reading, text
from srt3d_ros.errors import InvalidInput, require

SENSOR = "ST VL53L8CH, VL53L7CH: 4 × 4 or 8 × 8 zones"
READS = "CNH logs: CSV of ST's MZ-AI program, text of the Arduino example"
BIN_WIDTH_S = 2 * 37.5348e-3 / SPEED_OF_LIGHT       # VL53LMZ_CNH_BIN_WIDTH_MM
PULSE_BINS = 10             # VL53LMZ_CNH_PULSE_WIDTH_BIN, from its beginning to its end; taken for a raised cosine
FOV_DEG = 45.0
COLUMN = re.compile(r"cnh__hist_bin_(\d{1,3})_a(\d{1,2})")
LINE = re.compile(r"Aggregate (\d{1,2}), Ambient: *[-+.\deE]+, Bins: *(.+)")
NOTES = ("bins taken for the sensor's own from bin 0 on, and the pulse for a raised cosine of 10 bins: the log tells "
         "neither; a sidecar LOG.json may (docs/devices.md)",)


def recognises(head: str) -> bool:
    """Whether a log begins like one of these."""
    return COLUMN.search(head) is not None or LINE.search(head) is not None


def read(path: Path) -> Iterator[Reading]:
    """The frames of a log; InvalidInput where one is broken."""
    lines = text(path).splitlines()
    frames = _of_table(lines, path.name) if lines and COLUMN.search(lines[0]) else _of_lines(lines, path.name)
    for k, zones in enumerate(frames):
        yield reading(zones, f"{path.name} frame {k}")


def reading(zones: np.ndarray, name: str) -> Reading:
    """One frame, float [zones, bins]."""
    side = {1: 1, 4: 2, 9: 3, 16: 4, 25: 5, 36: 6, 49: 7, 64: 8}.get(len(zones), 0)
    require(side > 0 and bool(np.isfinite(zones).all()), name, f"{len(zones)} zones",
            "a square of zones, up to 8 × 8, and finite numbers")
    bins = zones.shape[1]
    irf = np.hanning(min(PULSE_BINS, bins - 1) + 1)[1:-1]
    sensor = SensorModel(side, side, bins, BIN_WIDTH_S, irf, len(irf) // 2, toa_reference="bin_edge",
                         projection=Pinhole.from_fov(side, side, FOV_DEG), frame_id="vl53l8ch")
    return Reading(sensor, PhotonHistograms(zones.reshape(side, side, bins).astype(np.float32)), NOTES)


def _of_table(lines: list[str], name: str) -> Iterator[np.ndarray]:
    """The frames of a CSV table."""
    rows = csv.reader(lines)
    found = {tuple(map(int, match.groups()))[::-1]: k for k, column in enumerate(next(rows))
             if (match := COLUMN.fullmatch(column.strip()))}
    require(bool(found), name, "without columns of bins", "cnh__hist_bin_0_a0, …")
    zones, bins = (1 + max(place[axis] for place in found) for axis in (0, 1))
    require(len(found) == zones * bins, name, f"{len(found)} columns of bins", f"{zones} × {bins}, one for each")
    columns = [found[zone, bin_] for zone in range(zones) for bin_ in range(bins)]
    for row in rows:
        yield _numbers((row[k] if k < len(row) else "" for k in columns), name).reshape(zones, bins)


def _of_lines(lines: list[str], name: str) -> Iterator[np.ndarray]:
    """The frames of an aggregate a line: each begins with aggregate 0. One without its end is left out."""
    frame, whole = [], None
    for match in filter(None, map(LINE.search, lines)):
        values = _numbers(match[2].strip().rstrip(",").split(","), name)
        if int(match[1]) == 0 and frame:
            whole = whole or len(frame)
            if len(frame) == whole:
                yield np.array(frame)
            frame = []
        if int(match[1]) == len(frame) and (not frame or len(values) == len(frame[0])):     # else one was lost
            frame.append(values)
    if frame and len(frame) == (whole or len(frame)):
        yield np.array(frame)


def _numbers(words: Iterable[str], name: str) -> np.ndarray:
    words = list(words)
    try:
        return np.array(words, np.float64)
    except ValueError:
        raise InvalidInput(name, ", ".join(words), "numbers, a bin each") from None
