"""The recorder's parameters: what they are, and what they mean for a recording."""

import os
import time
from pathlib import Path

import numpy as np

from srt3d_ros.colours import COLOUR_MAPS, RANGE_MAP
from srt3d_ros.errors import require
from srt3d_ros.nodes.parameters import Parameter, Parameters
from srt3d_ros.recording import schema
from srt3d_ros.recording.frame_log import COLOUR_BY, Colouring, Style
from srt3d_ros.recording.parts import Split

ADAPTIVE = "adaptive"
COLOUR_RANGE = "adaptive, or two rising numbers such as 0,50"
IMAGES = tuple(path.strip("/") for path in (schema.DEPTH, *schema.IMAGES))
ALL_IMAGES, NO_IMAGES = ",".join(IMAGES), "none"
WHICH_IMAGES = f"some of {ALL_IMAGES}, or {NO_IMAGES}"
PARAMETERS = (
    Parameter("path", "", "Path of the recording; if empty, recording_<UTC time>.rrd in the working directory. The "
              "first recording replaces an existing file, the next are NAME_2.rrd, NAME_3.rrd, …. With split_size_mb "
              "or split_period_s the files are NAME_001.rrd, NAME_002.rrd, …, and none is replaced.",
              form="a path that ends with .rrd"),
    Parameter("record", True, "true: record as soon as the node is active. false: from `~/start_recording` on."),
    Parameter("colour_by", COLOUR_BY[0], "What the colours of the points show. depth_std needs the reconstructor's "
              "`fields:=full`; without it, intensity is used. Height is along the sensor's up direction.",
              choices=COLOUR_BY),
    Parameter("colour_map", RANGE_MAP, "Colour map; all suit any colour vision. Bright is near for range, and high "
              "for everything else.", choices=COLOUR_MAPS),
    Parameter("colour_range", ADAPTIVE, "Values (photons or metres) of the first and the last colour. adaptive "
              "follows the clouds slowly.", form=COLOUR_RANGE),
    Parameter("images", ALL_IMAGES, "Images to record.", form=WHICH_IMAGES),
    Parameter("exact", False, "true: points in the published order, intensities and images in float32. false: points "
              "sorted, intensities in 11 bits, images rounded to a third of the photon noise: files are a third "
              "smaller. Positions are always exact."),
    Parameter("decimate", 1, "Record every n-th point.", low=1, high=1_000_000),
    Parameter("max_points", 0, "Thin out larger clouds evenly to at most this number of points; 0 = no limit.", low=0),
    Parameter("max_rate_hz", 0.0, "Most frames per second whose clouds and images are recorded; 0 = all. Time series "
              "have every frame.", "Hz", low=0.0),
    Parameter("split_size_mb", 0.0, "Start a new file at this size; 0 = one file.", "MB", low=0.0),
    Parameter("split_period_s", 0.0, "Start a new file after this time; 0 = one file.", "s", low=0.0),
    Parameter("live_port", 0, "Port on the loopback interface for viewers (`srt3d view --connect`); 0 = none.", low=0,
              high=65535),
    Parameter("live_memory_mb", 256, "Memory that keeps the newest frames for viewers that connect later.",
              "MB", low=16, high=100_000),
    Parameter("lossless", False, "Queue more frames before dropping, for replays faster than a sensor."),
)


class Settings:
    """The parameters of a recorder, parsed; raises InvalidInput if one cannot be used."""

    def __init__(self, values: Parameters):
        self.path = _checked_path(values["path"])
        colouring = Colouring(values["colour_by"], values["colour_map"], _checked_range(values["colour_range"]))
        self.style = Style(colouring, values["exact"])
        self.images = _checked_images(values["images"])
        self.split = Split(values["split_size_mb"], values["split_period_s"])
        self.live = (values["live_port"], values["live_memory_mb"]) if values["live_port"] else None
        self._decimate, self._max_points = values["decimate"], values["max_points"]

    def every(self, points: int) -> int:
        """n, to record every n-th point of a cloud with so many points."""
        return max(self._decimate, -(-points // self._max_points) if self._max_points else 1)


def _checked_path(text: str) -> Path:
    path = Path(text or time.strftime("recording_%Y%m%dT%H%M%SZ.rrd", time.gmtime())).absolute()
    require(path.suffix == ".rrd", "path", text, "a path that ends with .rrd")
    folder = path.parent
    require(folder.is_dir() and os.access(folder, os.W_OK), "path", text, "a file in a folder that can be written")
    return path


def _checked_range(text: str) -> tuple[float, float] | None:
    if text == ADAPTIVE:
        return None
    try:
        low, high = map(float, text.split(","))
    except ValueError:
        low = high = np.nan
    require(low < high < np.inf and low > -np.inf, "colour_range", text, COLOUR_RANGE)
    return low, high


def _checked_images(text: str) -> tuple[str, ...]:
    names = [] if text == NO_IMAGES else [name.strip() for name in text.split(",")]
    for name in names:
        require(name in IMAGES, "images", text, WHICH_IMAGES)
    return tuple(f"/{name}" for name in IMAGES if name in names)
