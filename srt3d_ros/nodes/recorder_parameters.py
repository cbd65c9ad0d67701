"""The recorder's parameters: what they are, and what they mean for a recording."""

import os
import time
from pathlib import Path

from srt3d_ros.errors import require
from srt3d_ros.nodes.parameters import Parameter, Parameters
from srt3d_ros.recording import schema
from srt3d_ros.recording.frame_log import COLOUR_BY

IMAGES = tuple(path.strip("/") for path in (schema.DEPTH, *schema.IMAGES))
ALL_IMAGES, NO_IMAGES = ",".join(IMAGES), "none"
WHICH_IMAGES = f"some of {ALL_IMAGES}, or {NO_IMAGES}"
PARAMETERS = (
    Parameter("path", "", "Path of the recording; if empty, recording_<UTC time>.rrd in the working directory. No file "
              "is replaced: where there is one, and for further recordings and parts, NAME_2.rrd, NAME_3.rrd, ….",
              form="a path that ends with .rrd"),
    Parameter("record", True, "true: record as soon as the node is active. false: from `~/start_recording` on."),
    Parameter("colour_by", COLOUR_BY[0], "What the colours of the points show. depth_std needs the reconstructor's "
              "`fields:=full`; without it, intensity is used. Height is along the sensor's up direction.",
              choices=COLOUR_BY),
    Parameter("images", ALL_IMAGES, "Images to record.", form=WHICH_IMAGES),
    Parameter("split_size_mb", 0.0, "Start a new file at this size; 0 = one file.", "MB", low=0.0),
    Parameter("live_port", 0, "Port on the loopback interface for viewers (`srt3d view --connect`); 0 = none.", low=0,
              high=65535),
)


class Settings:
    """The parameters of a recorder, parsed; raises InvalidInput if one cannot be used."""

    def __init__(self, values: Parameters):
        self.path = _checked_path(values["path"])
        self.colour_by = values["colour_by"]
        self.images = _checked_images(values["images"])
        self.split_size_mb, self.live_port = values["split_size_mb"], values["live_port"]


def _checked_path(text: str) -> Path:
    path = Path(text or time.strftime("recording_%Y%m%dT%H%M%SZ.rrd", time.gmtime())).absolute()
    require(path.suffix == ".rrd", "path", text, "a path that ends with .rrd")
    folder = path.parent
    require(folder.is_dir() and os.access(folder, os.W_OK), "path", text, "a file in a folder that can be written")
    return path


def _checked_images(text: str) -> tuple[str, ...]:
    names = [] if text == NO_IMAGES else [name.strip() for name in text.split(",")]
    for name in names:
        require(name in IMAGES, "images", text, WHICH_IMAGES)
    return tuple(f"/{name}" for name in IMAGES if name in names)
