"""Recordings of a ball to review, with a gap and all that a recorder records; and pages of reports."""

from html.parser import HTMLParser

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr

from srt3d_ros.messages import sensor_message
from srt3d_ros.recording import entities
from srt3d_ros.review.recorded import Recorded

FRAMES, PERIOD_NS, FIRST_NS = 30, 10**8, 1_795_285_122_000_000_000
MISSING = (10, 11)                  # of the sensor's frames: the recording has a gap
FEWEST, MOST = 5, 20


class Page(HTMLParser):
    """The tags of a page, each with its attributes, and its text."""

    def __init__(self, html: str):
        super().__init__()
        self.tags, self.text = [], ""
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text += data


@pytest.fixture(scope="session")
def ball_recording(tmp_path_factory, ball):
    """The path of a recording of the ball: clouds, a depth image each, series and properties.

    Frame k has 100 points less at FEWEST, all at MOST, otherwise 10 or so less; latency_ms is 30 + k.
    """
    path = tmp_path_factory.mktemp("recording") / "ball.rrd"
    write_ball(path, *ball)
    return path


@pytest.fixture(scope="session")
def recorded(ball_recording):
    """The recording, read."""
    return Recorded(ball_recording)


def write_ball(path, cloud, sensor, frames=FRAMES, missing=MISSING, more=lambda stream: None):
    """Write with rerun alone what docs/bags.md describes; `more` adds to it."""
    stream = rr.RecordingStream("srt3d_ros")
    stream.save(path)
    entities.log_properties(stream, "sensor", {"description": sensor_message.to_json(sensor)})
    stream.send_property("run", rr.AnyValues(frequencies=[1, 2, 5], machine="x86_64 <&>"))
    stream.send_property("versions", rr.AnyValues(srt3d_ros="0.1.0", numpy="0123456789abcdef"))
    frame = 0
    for k in range(frames):
        if k in missing:
            continue
        stream.set_time("stamp", timestamp=np.datetime64(FIRST_NS + k * PERIOD_NS, "ns"))
        stream.set_time("frame", sequence=frame)
        n = len(cloud) - {FEWEST: 100, MOST: 0}.get(frame, 10 + k % 3)
        stream.log("/points", rr.Points3D(cloud.xyz[:n], colors=np.full(n, 0xFF8000FF, np.uint32), radii=0.01),
                   rr.AnyValues(intensity=pa.array(cloud.intensity[:n]),
                                depth_std=pa.array(cloud.depth_std_bins[:n] * np.float32(sensor.bin_width_m))))
        stream.log("/depth", *entities.image("/depth", cloud.depth_image(), 0, 1)["/depth"])
        stream.log("/background", rr.DepthImage(cloud.background.astype(np.float16)))
        series = {"latency_ms": 30 + frame, "latency_sketch_ms": 5, "points": n, "photons": 9000 + k, "ppp": 4.5}
        for name, value in series.items():
            if (name, frame) != ("photons", 7):
                stream.log(f"/metrics/{name}", rr.Scalars(float(value)))
        frame += 1
    more(stream)
    stream.disconnect()
