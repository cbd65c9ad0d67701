"""The reconstructor's `free`, as a real subscriber sees it: it retreats before what appears, and comes back."""

import numpy as np
import pytest
from sensor_msgs.msg import Image, PointCloud2

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.messages import images_message, points_message, sensor_message, sketch_message

SIDE, PERIOD_M = 40, 15.0
SENSOR = SensorModel(SIDE, SIDE, 1000, 1e-10, np.exp(-np.arange(-16, 17)**2 / 32), frame_id="spad")
FREQUENCIES = choose_frequencies("auto", SENSOR, 10)
BRIGHTNESS, BACKGROUND, WALL_M, OBJECT_M = 120.0, 1.0, 8.0, 3.0
OBJECT = np.zeros((SIDE, SIDE), bool)
OBJECT[20:27, 24:31] = True


class Sensor:
    """Publishes frames of a wall on the left before open sky, with an object or not, ten in a second of stamps."""

    def __init__(self, graph):
        self.graph, self._rng, self._frames = graph, np.random.default_rng(1), 0
        graph.start("reconstructor", "-p", f"free_brightness:={BRIGHTNESS}").ready()
        description, self._sketches = graph.latched("sketch/sensor"), graph.publisher(PointCloud2, "sketch")
        self.points = graph.collect(PointCloud2, "points", raw=True)
        description.publish(sensor_message.encode_cdr(SENSOR))
        graph.matched(self._sketches)

    def watch(self) -> None:
        self.free = self.graph.collect(PointCloud2, "free", raw=True)
        self.graph.known_to("reconstructor")

    def frame(self, with_object: bool = False, laser: bool = True) -> None:
        """Send a frame and wait for its points."""
        range_m = np.full((SIDE, SIDE), np.inf)
        range_m[:, :8] = WALL_M
        range_m[OBJECT & with_object] = OBJECT_M
        signal = self._rng.poisson(laser * BRIGHTNESS / range_m**2).ravel()
        stray = self._rng.poisson(BACKGROUND, SIDE**2)
        pixel = np.repeat(np.tile(np.arange(SIDE**2, dtype=np.uint32), 2), np.r_[stray, signal])
        depth = np.repeat(np.where(np.isfinite(range_m), SENSOR.depth_bins(range_m), 0).ravel(), signal)
        toa = np.r_[self._rng.integers(0, 1000, stray.sum()), np.rint(self._rng.normal(depth, 4)) % 1000]
        order, before = np.argsort(pixel, kind="stable"), len(self.points)
        self._frames += 1
        events = PhotonEvents(pixel[order], toa[order].astype(np.uint16), self._frames * 100_000_000)
        self._sketches.publish(sketch_message.encode_cdr(sketch_photons(events, SENSOR, FREQUENCIES), "spad"))
        self.graph.wait(lambda: len(self.points) > before, "points")

    def free_m(self, *args) -> np.ndarray:
        """The range up to which each pixel is empty in a further frame, [rows, cols], NaN where nothing is claimed."""
        before = len(self.free)
        self.frame(*args)
        self.graph.wait(lambda: len(self.free) > before, "free")
        header, ends = points_message.decode_ends_cdr(self.free[-1])
        assert (header.stamp_ns, header.frame_id) == (self._frames * 100_000_000, "spad")
        range_m = np.linalg.norm(ends, axis=1)
        lens, image = SENSOR.projection, np.full((SIDE, SIDE), np.nan)
        col, row = (np.rint(ends[:, k] / ends[:, 2] * f + c).astype(int) for k, f, c in (
            (0, lens.fx, lens.cx), (1, lens.fy, lens.cy)))
        image[row, col] = range_m
        return image


@pytest.fixture
def spad(graph):
    return Sensor(graph)


def test_free_retreats_before_what_appears_comes_back_and_ends_with_the_laser(spad):
    for _ in range(3):
        spad.frame()
    spad.watch()
    empty = [spad.free_m() for _ in range(12)][-1]
    assert np.isfinite(empty[:, 12:]).mean() > 0.95 and 5 < np.nanmedian(empty) < PERIOD_M
    assert np.isnan(empty[:, :7]).mean() > 0.95 and not (empty[:, :7] > WALL_M + 0.2).any()
    there = spad.free_m(True)
    assert not (there[OBJECT] > OBJECT_M + 0.2).any()           # in the frame in which it appears
    assert np.isfinite(there[:, 12:20]).all()
    [spad.free_m(True) for _ in range(3)]
    gone = spad.free_m()
    assert (gone[OBJECT] > OBJECT_M + 0.2).mean() > 0.9         # in the frame in which it has left
    off = [spad.free_m(False, False) for _ in range(10)]
    assert np.isfinite(off[0]).any() and not np.isfinite(off[-1]).any()


def test_depth_says_where_it_is_empty_and_nothing_is_claimed_without_a_brightness(spad):
    spad.watch()
    depth = spad.graph.collect(Image, "depth", raw=True)
    spad.graph.known_to("reconstructor")

    def image(frames: int) -> np.ndarray:
        del depth[:]
        for _ in range(frames):
            spad.frame()
        spad.graph.wait(lambda: len(depth) == frames, "depth")
        return images_message.decode_cdr(depth[-1])[1]
    assert not np.isinf(image(4)).any()                         # no claim reaches the end of the period
    assert spad.graph.set("reconstructor", max_range_m=4.0) == ""
    near = image(2)
    assert np.isinf(near[:, 12:]).mean() > 0.95 and np.isnan(near[:, :7]).mean() > 0.95
    assert np.linalg.norm(points_message.decode_ends_cdr(spad.free[-1])[1], axis=1).max() <= 4.0001
    assert spad.graph.set("reconstructor", free_brightness=0.0) == ""
    spad.graph.wait(lambda: image(1) is not None and not np.isinf(image(1)).any(), "an image that claims nothing")
    seen = len(spad.free)
    image(2)
    assert len(spad.free) == seen
    assert spad.graph.set("reconstructor", method="smle", free_brightness=5.0).startswith(
        "free_brightness is 5.0: expected 0 with method smle")
    assert spad.graph.set("reconstructor", window_frames=3, free_brightness=5.0).startswith(
        "free_brightness is 5.0: expected 0 with window_frames 3")
