"""The recorder: what it makes of clouds and of disks, and how recordings begin and end."""

import signal

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.qos import ReliabilityPolicy
from rclpy.time import Time
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import images_message, points_message, sensor_message
from srt3d_ros.messages.odometry import encode_odometry
from srt3d_ros.messages.packing import encode_cloud
from srt3d_ros.nodes.recorder import checked_images, checked_path
from srt3d_ros.recording.reader import RecordingReader


@pytest.mark.parametrize("check, value, expected", [
    (checked_path, "a.mcap", "path is a.mcap: expected a path that ends with .rrd"),
    (checked_path, "absent/a.rrd", "path is absent/a.rrd: expected a file in a writable folder"),
    (checked_images, "depth,red", "images is depth,red: expected some of depth,intensity,background,photons, or none"),
])
def test_parameters_that_cannot_be_used_are_one_line(check, value, expected):
    with pytest.raises(InvalidInput) as caught:
        check(value)
    assert str(caught.value) == expected


# ---- The recorder by itself: the test speaks for the other nodes


START_NS = 10**18


class Speaker:
    """Says what sketcher and reconstructor would to a recorder: the sensor, then clouds."""

    def __init__(self, graph, sensor, path, code: str = ""):
        self.graph, self.sensor, self.sent = graph, sensor, 0
        self._described = graph.latched("sketch/sensor")
        self._points = graph.publisher(PointCloud2, "points")
        self.describe(sensor)
        self.recorder = graph.start("recorder", code=code, path=path).ready()

    def describe(self, sensor) -> None:
        self.say(sensor_message.to_json(sensor))

    def say(self, description: str) -> None:
        self._described.publish(String(data=description))

    def restart(self) -> None:
        """End the recording and begin another."""
        assert self.graph.change("recorder", "deactivate") and self.graph.change("recorder", "activate")

    def begin(self, path) -> "Speaker":
        """Begin a recording of `sensor` in this file, and wait until publisher and recorder have found each other."""
        assert self.graph.change("recorder", "deactivate")
        self.graph.wait(lambda: self.graph.node.count_subscribers("points") == 0, "the end of the recording")
        self.describe(self.sensor)
        assert self.graph.set("recorder", path=str(path)) == "" and self.graph.change("recorder", "activate")
        self.recorder.says(f"recording to {path}")
        return self.ready()

    def ready(self) -> "Speaker":
        self.graph.matched(self._points)
        self.graph.wait(lambda: self.graph.report("recorder").get("sent_by"), "a publisher in the recorder's report")
        return self

    def frame(self) -> int:
        """Send the next frame, 10 ms after the last: a cloud of 50 points; its stamp."""
        stamp_ns = START_NS + self.sent * 10**7
        cloud = np.ones(50, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
        self._points.publish(encode_cloud(cloud, stamp_ns, "spad"))
        self.sent += 1
        return stamp_ns

    def record(self, frames: int) -> list[int]:
        """Send frames and wait until they are recorded; their stamps."""
        before = self.graph.total("recorder", "clouds")
        stamps = [self.frame() for _ in range(frames)]
        self.graph.reports("recorder", "clouds", before + frames)
        return stamps


@pytest.fixture(scope="module")
def shared(shared_graph, sensor, tmp_path_factory):
    """A recorder that does not end before the tests."""
    speaker = Speaker(shared_graph, sensor, tmp_path_factory.mktemp("recorder") / "a.rrd")
    yield speaker
    assert speaker.recorder.end(signal.SIGINT) == 0 and "Traceback" not in speaker.recorder.text


@pytest.fixture
def speaker(shared, tmp_path):
    return shared.begin(tmp_path / "a.rrd")


def frames_of(*paths) -> list[int]:
    """The stamps of the clouds in recordings."""
    return sorted(cloud.stamp_ns for path in paths for cloud in RecordingReader(path).clouds())


def test_each_activation_and_each_sensor_begin_a_recording_of_their_own(speaker, sensor, tmp_path):
    paths = [tmp_path / name for name in ("a.rrd", "a_2.rrd", "a_3.rrd")]
    stamps = [speaker.record(3)]
    refused = speaker.graph.set("recorder", path=str(tmp_path / "other.rrd"))
    assert refused.startswith("path can be set while the recorder is inactive")
    speaker.restart()
    speaker.recorder.says(f"recording to {paths[1]}")
    stamps.append(speaker.ready().record(3))
    speaker.describe(sensor.replace(range_offset_m=1.0))
    speaker.recorder.says(f"recording to {paths[2]}")
    stamps.append(speaker.record(3))
    assert speaker.graph.change("recorder", "deactivate")
    assert [frames_of(path) for path in paths] == stamps
    recorded = [RecordingReader(path).properties["sensor"]["description"] for path in paths]
    assert [sensor_message.from_json(text).range_offset_m for text in recorded] == [0, 0, 1]
    assert speaker.graph.change("recorder", "activate")


def test_hot_pixels_that_are_left_out_begin_no_recording(speaker, sensor, tmp_path):
    stamps, mask = speaker.record(2), np.arange(sensor.pixels).reshape(sensor.rows, sensor.cols) != 77
    speaker.describe(sensor.replace(mask=mask))
    speaker.graph.known_to("recorder")
    stamps += speaker.record(2)
    assert speaker.graph.change("recorder", "deactivate") and frames_of(tmp_path / "a.rrd") == stamps
    text = RecordingReader(tmp_path / "a.rrd").properties["sensor"]["description"]
    assert np.array_equal(sensor_message.from_json(text).mask, mask)
    assert speaker.graph.change("recorder", "activate")


def test_empty_rays_are_recorded_in_the_frames_of_their_clouds(speaker, sensor, tmp_path):
    graph, far = speaker.graph, np.full((sensor.rows, sensor.cols), np.nan, np.float32)
    free = graph.matched(graph.publisher(PointCloud2, "free"))
    far[:2] = 7
    stamps = speaker.record(2)
    free.publish(points_message.encode_ends_cdr(far, sensor, stamps[1], "spad"))
    graph.reports("recorder", "frames_out", graph.total("recorder", "frames_out") + 1)
    assert graph.change("recorder", "deactivate")
    (stamp_ns, frame, ends), = RecordingReader(tmp_path / "a.rrd").empty_rays()
    assert (stamp_ns, frame) == (stamps[1], 1) and len(ends) == 2 * sensor.cols
    assert np.allclose(ends, 7 * sensor.rays[:2].reshape(-1, 3), rtol=1e-6)
    assert graph.change("recorder", "activate")


def test_what_a_stopped_recorder_misses_it_counts_and_nobody_waits_for_it(speaker):
    graph = speaker.graph
    reader, = graph.node.get_subscriptions_info_by_topic(f"{graph.namespace}/points")
    assert reader.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    speaker.record(1)

    def counted() -> int:
        return sum(graph.total("recorder", key) for key in ("clouds", "message_lost", "dropped"))

    sent, before, lost = speaker.sent, counted(), graph.total("recorder", "message_lost")
    speaker.recorder.pause()
    for _ in range(300):
        speaker.frame()
    speaker.recorder.resume()

    def shown() -> bool:
        speaker.frame()
        graph.next_reports("recorder", 1)
        return graph.total("recorder", "message_lost") > lost

    graph.wait(shown, "the loss, which the next cloud shows")
    graph.wait(lambda: counted() - before == speaker.sent - sent, "all clouds, recorded or counted")


def test_a_bad_description_is_an_error_until_a_good_one_comes_and_then_in_one_report(speaker):
    graph = speaker.graph
    assert graph.change("recorder", "deactivate")
    errors = graph.total("recorder", "errors")
    speaker.say("{")
    assert graph.change("recorder", "activate")
    graph.reports("recorder", "errors", errors + 1)
    assert [report["level"] for report in graph.next_reports("recorder", 2)] == [DiagnosticStatus.ERROR] * 2
    speaker.describe(speaker.sensor)
    speaker.ready().record(1)
    speaker.say("{")
    graph.reports("recorder", "errors", errors + 2)
    graph.wait(lambda: graph.report("recorder")["level"] != DiagnosticStatus.ERROR, "the end of the error")
    speaker.record(1)


def test_a_full_disk_ends_the_recording_with_one_error_and_not_the_node(graph, sensor, tmp_path):
    speaker = Speaker(graph, sensor, tmp_path / "a.rrd",
                      "from srt3d_ros.recording import writer; writer.LEAST_FREE_BYTES = 10**18")
    for number in (1, 2):       # another can be tried
        report = graph.reports("recorder", "errors", number)
        assert report["last_error"].startswith(f"recording {tmp_path / 'a.rrd'}: stopped, as the disk has only ")
        graph.reports("recorder", "path", "")
        assert all((one["level"], one["ready"]) == (DiagnosticStatus.ERROR, "False")
                   and one["message"].startswith("not recording: stopped, as the disk has only ")
                   for one in graph.next_reports("recorder", 3))        # as long as it lasts
        if number == 1:
            speaker.restart()
    assert speaker.recorder.end(signal.SIGTERM) == 1
    assert graph.reports("recorder", "state", "finalized")["level"] == DiagnosticStatus.ERROR


def test_with_odometry_each_cloud_has_the_sensors_pose_and_without_it_the_recording_goes_on(graph, sensor, tmp_path):
    path, mount = tmp_path / "a.rrd", Pose.from_quaternion((0.5, -0.5, 0.5, -0.5), (0.2, 0, 0.1))
    reports = graph.publisher(Odometry, "odom")
    images = graph.publisher(Image, "depth")
    speaker = Speaker(graph, sensor.replace(extrinsics="0.2 0 0.1 0.5 -0.5 0.5 -0.5"), path).ready()
    graph.matched(reports), graph.matched(images)

    def body(stamp_ns: int) -> Pose:
        t_s = (stamp_ns - START_NS) * 1e-9
        return Pose(Pose.turned([0, 0, 0.5 * t_s]).rotation, np.array([t_s, 0, 0]))

    def report(stamp_ns: int, frame_id: str = "odom", x_m: float = 0.0) -> None:
        pose = body(stamp_ns)
        message = encode_odometry(Pose(pose.rotation, pose.translation + (x_m, 0, 0)))
        message.header.stamp, message.header.frame_id = Time(nanoseconds=stamp_ns).to_msg(), frame_id
        reports.publish(message)

    early = speaker.record(3)                           # before odometry
    for ms in range(1000, 1500, 20):
        report(START_NS + ms * 10**6)
    bad = Odometry()
    bad.pose.pose.position.x = np.nan
    reports.publish(bad)
    speaker.sent = 110
    placed = []
    for _ in range(20):                                 # 100 Hz
        placed.append(speaker.frame())
        images.publish(images_message.encode_cdr(np.ones((16, 12), np.float32), placed[-1], "spad"))
    graph.reports("recorder", "clouds_placed", 20)
    graph.reports("recorder", "clouds_unplaced", 3)
    graph.reports("recorder", "images_skipped", 18)
    speaker.sent = 160
    late = [speaker.frame()]                            # whose odometry comes after it
    graph.reports("recorder", "clouds", 24)
    assert graph.total("recorder", "clouds_placed") == 20
    for ms in range(1500, 1700, 20):
        report(START_NS + ms * 10**6)
    report(START_NS + 1700 * 10**6, "map", 30.0)         # another frame: a jump of 30 m
    report(START_NS + 1800 * 10**6, "map", 30.0)
    speaker.sent = 175
    late.append(speaker.frame())
    graph.reports("recorder", "clouds_placed", 22)
    said = graph.report("recorder")
    assert (said["motion_restarts"], said["motion_refused"]) == ("1", "1")
    speaker.sent = 400
    speaker.record(2)                                   # odometry has stopped
    assert speaker.recorder.end(signal.SIGTERM) == 0 and "Traceback" not in speaker.recorder.text
    graph.reports("recorder", "clouds_unplaced", 5)

    reader = RecordingReader(path)
    clouds = {cloud.frame_index: cloud for cloud in reader.clouds()}
    poses = {clouds[frame].stamp_ns: pose for frame, pose in reader.poses().items()}
    assert sorted(poses) == placed + late and not set(early) & set(poses)
    for stamp_ns, pose in poses.items():
        expected = Pose((body(stamp_ns) @ mount).rotation, (body(stamp_ns) @ mount).translation
                        + (30 * (stamp_ns == late[1]), 0, 0))
        np.testing.assert_allclose(pose.translation, expected.translation, atol=1e-3)
        np.testing.assert_allclose(pose.rotation, expected.rotation, atol=1e-4)
    assert all((cloud.xyz == 1).all() for cloud in clouds.values())         # as they came
    assert [stamp_ns for stamp_ns, _, _ in reader.images("/depth")] == [placed[0], placed[15]]     # 5 Hz ± 50 ms


BUSY = """from srt3d_ros.nodes.recorder import RecorderNode as Node
subscribe = Node.subscribe          # clouds wait for the end
Node.subscribe = lambda self, topic, handle: subscribe(
    self, topic, lambda raw: (topic.name != "points" or self.stopping.wait()) and handle(raw))"""


def test_no_recording_begins_at_the_end_of_another(graph, sensor, tmp_path):
    speaker = Speaker(graph, sensor, tmp_path / "a.rrd", BUSY).ready()
    recorder = speaker.recorder.says("recording to")
    speaker.frame()
    graph.reports("recorder", "messages_in", 1)
    for number in (2, 3):
        speaker.describe(sensor.replace(range_offset_m=float(number)))
        graph.known_to("recorder")      # which has queued the description then
        speaker.frame()
        graph.reports("recorder", "messages_in", number)
    assert recorder.end(signal.SIGTERM) == 0 and recorder.text.count("recording to") == 1
    assert len(frames_of(tmp_path / "a.rrd")) == 1 and not (tmp_path / "a_2.rrd").exists()
    graph.reports("recorder", "dropped.not_recording", 2)


# ---- With the other nodes


def test_a_recording_has_all_that_the_nodes_published(graph, photon_file, tmp_path):
    path, frames = tmp_path / "a.rrd", 10
    clouds = graph.collect(PointCloud2, "points", raw=True)
    recorder = graph.start("recorder", path=path).ready()
    graph.start("reconstructor", fields="full")
    graph.start("sketcher", sketch_size=7)
    player = graph.start("player", input=photon_file, rate_hz=2.0, frames=frames,
                         wait_for="sketcher reconstructor recorder")
    assert player.code() == 0 and ", none lost: " in player.text, player.text
    graph.wait(lambda: len(clouds) == frames, "every cloud")
    graph.wait(lambda: graph.total("recorder", "frames_out") == 5 * frames, "its sketches and images")
    assert recorder.end(signal.SIGTERM) == 0 and "Warning" not in recorder.text, recorder.text
    last, reader = graph.reports("recorder", "state", "finalized"), RecordingReader(path)
    assert (last["errors"], last["dropped"]) == ("0", "0")

    seen = dict(points_message.decode_cdr(raw) for raw in clouds)
    seen = {header.stamp_ns: columns for header, columns in seen.items()}
    recorded = list(reader.clouds())
    assert len(recorded) == frames
    for cloud in recorded:
        columns = seen[cloud.stamp_ns]
        assert np.array_equal(cloud.xyz, columns["xyz"]) and np.array_equal(cloud.intensity, columns["intensity"])
        assert np.array_equal(cloud.more["depth_std"], columns["depth_std"])
    for name in ("/depth", "/intensity", "/background", "/photons"):
        assert len(list(reader.images(name))) == frames, name
    series = reader.series
    parts = series.pop("latency_reconstruct_ms")        # of clouds that came after their sketch, as on an idle machine
    assert {name: len(one.values) for name, one in series.items()} == {
        "frame_rate_hz": frames - 1, "latency_ms": frames, "points": frames} | dict.fromkeys((
            "latency_sketch_ms", "photons", "ppp"), frames)
    total, sketch = (one.values[np.isin(one.stamp_ns, parts.stamp_ns)] for one in (
        series["latency_ms"], series["latency_sketch_ms"]))
    assert len(parts.values) > 0 and np.allclose(total, sketch + parts.values) and (parts.values > 0).all()
    properties = reader.properties
    assert properties["run"]["namespace"] == graph.namespace
    assert properties["versions"]["rerun"] == "0.41.0"
