"""The reconstructor alone: clouds, images on demand, bad messages, and parameters that change."""

import dataclasses
import itertools

import numpy as np
import pytest
import torch
from nav_msgs.msg import Odometry
from rclpy.time import Time
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.messages import cdr, images_message, points_message, sensor_message, sketch_message
from srt3d_ros.messages.odometry import encode_odometry
from srt3d_ros.nodes.common import topics
from srt3d_ros.nodes.reconstructor import PARAMETERS
from tests.nodes.conftest import Graph

STAMP_NS = 1_700_000_000_123_456_789
LIVE = {parameter.name: parameter.default for parameter in PARAMETERS if parameter.live}


class Reconstructor:
    """A reconstructor and what it publishes of one frame after the other, which the tests share."""

    def __init__(self, graph: Graph):
        self.graph = graph
        self.process = graph.start("reconstructor").ready()
        self._description, self._sketches = graph.latched("sketch/sensor"), graph.publisher(PointCloud2, "sketch")
        self.clouds = graph.collect(PointCloud2, "points", raw=True)

    def watch_images(self) -> None:
        """Subscribe to the images, which are published from now on."""
        self._images = {topic.name: self.graph.collect(Image, topic.name, raw=True) for topic in topics.IMAGE_TOPICS}
        self.cameras = self.graph.collect(CameraInfo, "camera_info")
        self.graph.known_to("reconstructor")

    def begin(self, sensor: SensorModel, sketch: PhaseSums, **parameters) -> None:
        """Describe the sketches to a node whose live parameters are these, and that is in its initial state."""
        assert self.graph.change("reconstructor", "deactivate")
        self.graph.wait(lambda: self._sketches.get_subscription_count() == 0, "nobody on sketch")
        assert self.graph.set("reconstructor", **LIVE | {"fields": "full"} | parameters) == ""
        assert self.graph.change("reconstructor", "activate")
        self.describe(sensor)

    def describe(self, sensor: SensorModel) -> None:
        self._description.publish(sensor_message.encode_cdr(sensor))
        self.graph.matched(self._sketches)
        self.graph.wait(lambda: [self.graph.report("reconstructor").get(key) for key in ("rows", "num_bins")]
                        == [str(sensor.rows), str(sensor.num_bins)], "the description")

    def send(self, *sketches: PhaseSums | bytes) -> None:
        for sketch in sketches:
            data = sketch if isinstance(sketch, bytes) else sketch_message.encode_cdr(sketch, "spad")
            self._sketches.publish(data)

    def __call__(self, *sketches: PhaseSums) -> list[tuple]:
        """Header and points of the clouds of these sketches."""
        before = len(self.clouds)
        self.send(*sketches)
        self.graph.wait(lambda: len(self.clouds) == before + len(sketches), f"{len(sketches)} clouds")
        return [points_message.decode_cdr(raw) for raw in self.clouds[before:]]

    def frame(self, sketch: PhaseSums) -> tuple[dict, dict[str, np.ndarray]]:
        """Points and images of a sketch."""
        for received in self._images.values():
            received.clear()
        (_, points), = self(sketch)
        self.graph.wait(lambda: all(self._images.values()), "all images")
        decoded = {name: images_message.decode_cdr(received[0]) for name, received in self._images.items()}
        assert {(header.stamp_ns, header.frame_id) for header, _ in decoded.values()} == {(sketch.stamp_ns, "spad")}
        return points, {name: image for name, (_, image) in decoded.items()}

    def totals(self, *names: str, **expected: int) -> list[int]:
        """These counts in the diagnostics, once they show what is expected."""
        for name, value in expected.items():
            self.graph.reports("reconstructor", name, value)
        return [self.graph.total("reconstructor", name) for name in names]


@pytest.fixture(scope="module")
def sketch(sensor, events):
    """The sketch of the plane at bin 50."""
    frequencies = choose_frequencies("auto", sensor, 10)
    return sketch_photons(dataclasses.replace(events, stamp_ns=STAMP_NS), sensor, frequencies)


@pytest.fixture(scope="module")
def reconstructor(shared_graph):
    return Reconstructor(shared_graph)


def lies_at(points: dict, sensor: SensorModel, depth: float) -> bool:
    return abs(np.median(np.linalg.norm(points["xyz"], axis=1)) - sensor.range_m(depth)) < sensor.bin_width_m


def test_a_cloud_keeps_stamp_and_frame_and_bad_sketches_are_survived(reconstructor, sensor, sketch):
    reconstructor.begin(sensor, sketch)
    raw = sketch_message.encode_cdr(sketch, "spad")
    whole = cdr.CloudMessage.read(raw)
    small = dataclasses.replace(whole, height=8, data=whole.data[:8 * whole.row_step])
    reconstructor.send(raw[:200], small.write())
    (header, points), = reconstructor(sketch)
    assert (header.stamp_ns, header.frame_id) == (STAMP_NS, "spad")
    assert len(points["xyz"]) > 0.9 * sensor.pixels and lies_at(points, sensor, 50)
    assert reconstructor.totals("messages_in", "dropped.malformed", "photons", "points", frames_out=1) == [
        3, 2, sketch.photons.sum(), len(points["xyz"])]
    device = reconstructor.graph.report("reconstructor")["device"]
    assert device.startswith("cuda: " if torch.cuda.is_available() else "cpu: ") and len(device) > 8       # and why
    said = reconstructor.process.text
    assert said.count("no CUDA device: computing on the CPU") == (not torch.cuda.is_available())
    assert "Traceback" not in said


def test_where_the_cycles_are_known_pile_up_is_corrected_and_saturated_pixels_are_warned_of(
        reconstructor, sensor, sketch):
    reconstructor.begin(sensor, sketch)
    most = int(sketch.photons.max())
    plain, piled = (reconstructor(dataclasses.replace(sketch, cycles=cycles))[0][1] for cycles in (0, 2 * most))
    assert piled["intensity"].mean() > 1.1 * plain["intensity"].mean()
    reconstructor.graph.reports("reconstructor", "saturated_pixels", 0)
    assert float(reconstructor.graph.report("reconstructor")["background_share"]) < 1
    reconstructor(dataclasses.replace(sketch, cycles=most))
    pixels = int((sketch.photons > 0.95 * most).sum())
    said = f"saturated pixels: {pixels} (a photon in over 95% of the cycles)"
    reconstructor.graph.wait(lambda: reconstructor.graph.report("reconstructor").get("message") == said, "a warning")
    without = dataclasses.replace(sketch, cycles=0)
    reconstructor.graph.wait(lambda: reconstructor(without) and not reconstructor.graph.report("reconstructor")[
        "message"].startswith(("saturated", "waiting")), "the end of the warning")


def test_saturated_pixels_and_a_window_without_motion_are_warned_of_side_by_side(reconstructor, sensor, sketch):
    graph, moving = reconstructor.graph, sensor.replace(extrinsics="0 0 0 0 0 0 1")
    saturated = dataclasses.replace(sketch, sensor=moving, cycles=int(sketch.photons.max()))
    reconstructor.begin(moving, saturated, window_frames=2)
    odom = graph.matched(graph.publisher(Odometry, "odom"))
    stamps = (STAMP_NS + k * 10**8 for k in itertools.count())

    def warnings(with_motion: bool) -> list[str]:
        """What the report after one more frame warns of."""
        stamp_ns = next(stamps)
        for ms in range(-120, 21, 20) if with_motion else ():
            message = encode_odometry(Pose())
            message.header.stamp = Time(nanoseconds=stamp_ns + ms * 10**6).to_msg()
            odom.publish(message)
        reconstructor(dataclasses.replace(saturated, stamp_ns=stamp_ns))
        texts = graph.next_reports("reconstructor", 2)[-1]["message"].split("; ")
        return [text.partition(":")[0] for text in texts if not text.startswith("waiting")]

    both = ["saturated pixels", "windows of one frame"]
    graph.wait(lambda: sorted(warnings(with_motion=False)) == both, "both warnings")
    graph.wait(lambda: warnings(with_motion=True) == both[:1], "motion")
    assert [warnings(with_motion=True) for _ in range(3)] == 3 * [both[:1]]
    assert reconstructor.process.text.count("windows follow the motion again") == 1
    graph.wait(lambda: sorted(warnings(with_motion=False)) == both, "both warnings again")
    assert graph.set("reconstructor", window_frames=1) == "" and warnings(with_motion=False) == both[:1]


def test_a_plane_that_hides_the_scene_behind_it_is_warned_of(reconstructor, sensor, events, sketch):
    reconstructor.begin(sensor, sketch)
    behind = events.part(slice(None, None, 2))
    behind = dataclasses.replace(behind, toa=(behind.toa + 30) % np.uint16(sensor.num_bins))
    pixel, toa = (np.concatenate([getattr(one, name) for one in (events, behind)]) for name in ("pixel", "toa"))
    hidden = sketch_photons(PhotonEvents(pixel, toa), sensor, sketch.frequencies)
    reconstructor.graph.wait(lambda: reconstructor(hidden) and "surfaces of 2 show what is behind" in
                             reconstructor.graph.report("reconstructor").get("message", ""), "a warning")
    reconstructor.graph.wait(lambda: reconstructor(sketch) and "surfaces of 2" not in
                             reconstructor.graph.report("reconstructor").get("message", ""), "the end of the warning")


def test_points_and_images_agree_on_what_is_within_the_limits(reconstructor, sensor, sketch):
    reconstructor.watch_images()
    reconstructor.begin(sensor, sketch, fields="xyzi")
    before, = reconstructor.totals("points_out_of_range")
    _, images = reconstructor.frame(sketch)
    seen, depth_m = np.isfinite(images["depth"]), images["depth"]
    assert {image.shape for image in images.values()} == {(16, 12)} and (np.isfinite(images["intensity"]) == seen).all()
    assert abs(np.nanmedian(depth_m) - sensor.range_m(50)) < sensor.bin_width_m
    camera = reconstructor.graph.wait(lambda: reconstructor.cameras, "the camera")[0]
    assert (camera.height, camera.width, camera.header.frame_id) == (16, 12, "spad")
    middle_m = float(np.nanmedian(depth_m / sensor.rays[..., 2]))
    assert reconstructor.graph.set("reconstructor", min_range_m=0.5, max_range_m=middle_m, fields="full") == ""
    near, images = reconstructor.frame(sketch)
    assert 0.2 * sensor.pixels < len(near["xyz"]) < 0.8 * sensor.pixels
    assert np.linalg.norm(near["xyz"], axis=1).max() <= middle_m * (1 + 1e-6)
    for image, column in ((images["depth"], near["xyz"][:, 2]), (images["intensity"], near["intensity"])):
        assert np.isfinite(image).sum() == len(column) and (image[near["row"], near["col"]] == column).all()
    reconstructor.totals(points_out_of_range=before + int(seen.sum()) - len(near["xyz"]))
    assert reconstructor.graph.set("reconstructor", organised=True) == ""
    organised, _ = reconstructor.frame(sketch)
    message = cdr.CloudMessage.read(reconstructor.clouds[-1])
    assert (message.height, message.width, message.is_dense) == (16, 12, False)
    assert organised.keys() == near.keys() and all(np.array_equal(organised[name], near[name]) for name in near)


def test_parameters_are_refused_with_the_reason_or_change_between_frames(reconstructor, sensor, sketch):
    reconstructor.begin(sensor, sketch, max_range_m=4.0)
    for values, reason in (({"min_range_m": 4.0}, "min_range_m is 4.0: expected less than max_range_m, 4 m"),
                           ({"method": "smle", "background": "flat"},
                            "background flat: smle takes only surfaces, device"),
                           *([] if torch.cuda.is_available() else [({"device": "cuda"}, "device is cuda: expected ")])):
        assert reconstructor.graph.set("reconstructor", **values).startswith(reason)
    assert reconstructor.graph.set("reconstructor", min_range_m=0.0, max_range_m=0.0) == ""
    intensities = []
    for at, change in enumerate(({"background": "flat"}, {"method": "smle", "background": "auto"},
                                 {"method": "pooled", "background": "flat"})):
        assert reconstructor.graph.set("reconstructor", **change) == ""
        stamps = [STAMP_NS + 2 * at + k for k in range(2)]
        clouds = reconstructor(*(dataclasses.replace(sketch, stamp_ns=stamp_ns) for stamp_ns in stamps))
        assert [header.stamp_ns for header, _ in clouds] == stamps
        points = clouds[-1][1]
        assert len(points["xyz"]) > 0.8 * sensor.pixels and lies_at(points, sensor, 50)
        intensities.append(points["intensity"].tolist())
    assert intensities[0] == intensities[2] != intensities[1]
    assert reconstructor.totals("errors") == [0]


def test_sketches_are_read_with_the_descriptions_that_they_name_and_wait_for_them(
        reconstructor, sensor, events, sketch):
    """The same rows and columns, but another T: read with the other description they would be at other depths."""
    wide = sensor.replace(num_bins=128)
    of_wide, fewer = dataclasses.replace(sketch, sensor=wide), sketch_photons(events, sensor, sketch.frequencies[:7])
    reconstructor.begin(sensor, sketch)
    before = len(reconstructor.clouds)
    reconstructor.send(of_wide, sketch, fewer, of_wide)
    reconstructor.graph.wait(lambda: len(reconstructor.clouds) == before + 2, "the clouds of what is described")
    missing = f"sensor_{sensor_message.digest(wide)} on {reconstructor.graph.namespace}/sketch/sensor (publishers: "
    reconstructor.graph.wait(lambda: reconstructor.graph.report("reconstructor").get("waiting_for", "").startswith(
        f"the sketch's description {missing}"), "a report of what the others wait for")
    reconstructor.graph.reports("reconstructor", "under_way", 2)
    reconstructor.describe(wide)
    reconstructor.send(sketch)
    reconstructor.graph.wait(lambda: len(reconstructor.clouds) == before + 5, "all clouds")
    clouds = [points_message.decode_cdr(raw)[1] for raw in reconstructor.clouds[before:]]
    assert [lies_at(points, sensor, 50) for points in clouds] == [True, True, False, False, True]
    assert all(lies_at(points, sensor, 64) for points in clouds[2:4])
    reconstructor.graph.wait(lambda: "sketch/sensor" not in reconstructor.graph.report("reconstructor").get(
        "waiting_for", ""), "nothing to be waited for")
