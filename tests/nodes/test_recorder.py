"""The recorder: what it makes of clouds, of the other nodes' words and of disks, and recordings that services begin."""

import resource
import signal
import time
from contextlib import suppress

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import Log
from sensor_msgs.msg import PointCloud2

from srt3d_ros.core.sketch import Sketch
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.messages.cdr import Header, write_cloud
from srt3d_ros.messages.packing import pack_cloud
from srt3d_ros.nodes.diagnostics import PIPELINE_ID
from srt3d_ros.nodes.frame_index import STAMPS_KEPT, FrameIndex
from srt3d_ros.nodes.graph_watch import Drops, own_name
from srt3d_ros.nodes.recorder_parameters import PARAMETERS, Settings
from srt3d_ros.recording.reader import RecordingReader
from srt3d_ros.recording.repair import repair

IN_FLIGHT = 80          # clouds that the speaker may be ahead: fewer than its own queue of 100 holds
ASKED_TWICE = 8         # reports of a node, by which a recorder has asked it for its parameters again


def report(name: str, dropped: int, lost: int = 0, hardware_id: str = PIPELINE_ID) -> DiagnosticArray:
    values = [KeyValue(key="dropped", value=str(dropped)), KeyValue(key="message_lost", value=str(lost))]
    return DiagnosticArray(status=[DiagnosticStatus(name=name, hardware_id=hardware_id, values=values)])


def test_drops_of_the_nodes_in_the_namespace_add_up_and_a_restart_does_not_set_them_back():
    drops, totals = Drops(), []
    for message in (report("left/sketcher", 2), report("left/reconstructor", 3, lost=1), report("left/sketcher", 5),
                    report("left/sketcher", 1),         # after a restart
                    report("right/sketcher", 2), report("left_too/sketcher", 2),
                    report("left/motor", 4, hardware_id="motor")):
        drops.add(message, "/left")
        totals.append(drops.total)
    assert totals == [2, 6, 9, 10, 10, 10, 10]
    drops.add(report("sketcher", 2), "/")
    assert drops.total == 12


@pytest.mark.parametrize("namespace, name, expected", [
    ("/", "sketcher", "sketcher"), ("/", "left.sketcher", None), ("/a/left", "a.left.sketcher", "sketcher"),
    ("/left", "left_too.sketcher", None)])
def test_log_lines_are_of_the_nodes_in_the_namespace(namespace, name, expected):
    assert own_name(Log(name=name), namespace) == expected


def test_frames_are_numbered_as_their_stamps_come_and_kept_at_most_so_often():
    frames = FrameIndex(max_rate_hz=10.0)
    stamps = [0, 30, 99, 100, 199, 301, 301, 5]                  # ms; the last after a new beginning
    seen = [frames[stamp * 10**6] for stamp in stamps]
    assert [frame.number for frame in seen] == [0, 1, 2, 3, 4, 5, 5, 6]
    assert [frame.kept for frame in seen] == [True, False, True, False, True, True, True, True]
    assert frames.newest.stamp_ns == 301 * 10**6
    for stamp in range(1000, 1000 + STAMPS_KEPT):
        frames[stamp * 10**6]
    assert frames[30 * 10**6].number == 7 + STAMPS_KEPT         # forgotten, and new again


@pytest.mark.parametrize("changed, expected", [
    ({"path": "a.mcap"}, "path is a.mcap: expected a path that ends with .rrd"),
    ({"path": "absent/a.rrd"}, "path is absent/a.rrd: expected a file in a folder that can be written"),
    ({"colour_range": "5,2"}, "colour_range is 5,2: expected adaptive, or two rising numbers such as 0,50"),
    ({"colour_range": "a lot"}, "colour_range is a lot: expected adaptive, or two rising numbers such as 0,50"),
    ({"images": "depth,red"}, "images is depth,red: expected some of depth,intensity,background,photons, or none"),
])
def test_parameters_that_cannot_be_used_are_one_line(changed, expected):
    values = {parameter.name: parameter.default for parameter in PARAMETERS} | changed
    with pytest.raises(InvalidInput) as caught:
        Settings(values)
    assert str(caught.value) == expected


def test_parameters_say_what_is_recorded():
    defaults = {parameter.name: parameter.default for parameter in PARAMETERS}
    chosen = {"colour_range": "0.5,20", "images": "photons, depth", "decimate": 3, "max_points": 100}
    settings = Settings(defaults | chosen)
    assert settings.style.colouring.fixed_range == (0.5, 20) and settings.images == ("/depth", "/photons")
    assert [settings.every(points) for points in (0, 100, 300, 301, 1000)] == [3, 3, 3, 4, 10]
    assert Settings(defaults).every(10**6) == 1 and not Settings(defaults).split and Settings(defaults).live is None


# ---- The recorder by itself: the test speaks for the other nodes


class Speaker:
    """Says what sketcher and reconstructor would: the sensor, then clouds, and sketches where asked for."""

    def __init__(self, graph, sensor):
        self.graph, self.sensor, self.frequencies, self.sent = graph, sensor, (1, 2), 0
        self._described = graph.latched("sketch/sensor")
        self._points, self._sketches = graph.publisher(PointCloud2, "points"), graph.publisher(PointCloud2, "sketch")
        self.describe(sensor)

    def describe(self, sensor) -> None:
        self._described.publish(sketch_message.encode_sensor(sensor, self.frequencies, 1))

    def stop_clouds(self) -> None:
        self.graph.node.destroy_publisher(self._points)

    def ready(self) -> "Speaker":
        self.graph.matched(self._points)
        self.graph.matched(self._sketches)
        return self

    @property
    def stamp_ns(self) -> int:
        """Of the next frame, 10 ms after the last."""
        return 10**18 + self.sent * 10**7

    def sketch(self) -> None:
        """Send the next frame's sketch."""
        counts = np.full((self.sensor.rows, self.sensor.cols), self.sent, np.uint32)
        z = np.zeros((*counts.shape, 2), np.complex64)
        self._sketches.publish(sketch_message.encode_cdr(Sketch(self.frequencies, z, counts, self.stamp_ns), "spad"))

    def sketch_only(self) -> int:
        """Send the next frame, which gets no cloud; its stamp."""
        stamp_ns = self.stamp_ns
        self.sketch()
        self.sent += 1
        return stamp_ns

    def cloud(self, points: int = 50, sketch: bool = False) -> int:
        """Send the next frame; its stamp."""
        stamp_ns = self.stamp_ns
        if sketch:
            self.sketch()
        rng = np.random.default_rng(self.sent)
        cloud = np.zeros(points, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
        for name in cloud.dtype.names:
            cloud[name] = rng.uniform(1, 2, points)
        self._points.publish(write_cloud(pack_cloud(Header(stamp_ns, "spad"), cloud)))
        self.sent += 1
        return stamp_ns


@pytest.fixture
def speaker(graph, sensor):
    return Speaker(graph, sensor)


def frames_of(*paths) -> list[int]:
    """The stamps of the clouds in recordings."""
    return sorted(cloud.stamp_ns for path in paths for cloud in RecordingReader(path).clouds())


def test_recordings_begin_and_end_when_the_services_say_and_each_is_a_file_of_its_own(graph, speaker, tmp_path):
    recorder = graph.start("recorder", path=tmp_path / "out.rrd", record=False).ready()

    paths = [tmp_path / "out.rrd", tmp_path / "out_2.rrd"]
    for number, path in enumerate(paths, start=1):
        assert not path.exists() and graph.node.count_subscribers("points") == 0
        assert graph.trigger("recorder/start_recording") == (True, f"recording to {path}")
        assert not graph.trigger("recorder/start_recording")[0]
        speaker.ready()
        for _ in range(3):
            speaker.cloud()
        graph.reports("recorder", "clouds", 3 * number)
        assert graph.trigger("recorder/stop_recording") == (True, f"recorded {path}")
        graph.wait(lambda: graph.node.count_subscribers("points") == 0, "the end of the recording")
    assert [len(frames_of(path)) for path in paths] == [3, 3]
    assert recorder.end(signal.SIGINT) == 0 and "Traceback" not in recorder.text


def test_decimated_thinned_and_slowed_down_clouds_with_time_series_of_every_frame(graph, speaker, tmp_path):
    recorder = graph.start("recorder", path=tmp_path / "a.rrd", decimate=2, max_points=20, max_rate_hz=50.0,
                           images="none").ready()
    speaker.ready()
    stamps = [speaker.cloud(points, sketch=True) for points in (10, 10, 200, 200, 30, 30)]
    graph.reports("recorder", "frames_out", 12)
    assert recorder.end(signal.SIGTERM) == 0
    reader = RecordingReader(tmp_path / "a.rrd")
    clouds = {cloud.stamp_ns: len(cloud) for cloud in reader.clouds()}
    assert clouds == dict(zip(stamps[::2], (5, 20, 15)))        # every second is 20 ms after the last
    series = reader.series()
    assert series["points"].values.tolist() == [10, 10, 200, 200, 30, 30]
    assert series["photons"].values.tolist() == [192 * k for k in range(6)]
    assert series["ppp"].values.tolist() == list(range(6))
    assert series["frame_rate_hz"].values.tolist() == pytest.approx([100] * 5)
    for name in ("latency_ms", "latency_sketch_ms"):
        assert series[name].stamp_ns.tolist() == stamps
    assert not list(reader.images("/photons"))


def test_photon_counts_are_of_frames_with_clouds_and_of_all_where_nobody_makes_clouds(graph, speaker, tmp_path):
    recorder = graph.start("recorder", path=tmp_path / "a.rrd").ready()
    speaker.ready()
    stamps = []
    for _ in range(3):
        speaker.sketch_only()       # the reconstructor drops this one
        stamps.append(speaker.cloud(sketch=True))
    graph.reports("recorder", "frames_out", 9)
    speaker.stop_clouds()
    graph.wait(lambda: not graph.node.count_publishers("points"), "an end of the clouds")
    graph.known_to("recorder")          # which has then seen that end as well
    stamps += [speaker.sketch_only() for _ in range(3)]
    graph.reports("recorder", "frames_out", 12)
    assert recorder.end(signal.SIGTERM) == 0
    reader = RecordingReader(tmp_path / "a.rrd")
    images = {stamp: image for stamp, _, image in reader.images("/photons")}
    assert sorted(images) == stamps
    assert all((image == (stamp - 10**18) // 10**7).all() for stamp, image in images.items())
    assert reader.series()["photons"].values.tolist() == [192 * k for k in range(9)]


def test_parts_have_every_frame_and_another_sensor_begins_another_recording(graph, speaker, sensor, tmp_path):
    recorder = graph.start("recorder", path=tmp_path / "a.rrd", split_period_s=0.3, lossless=True).ready()
    speaker.ready()

    def record_until(parts: int) -> None:
        while len(list(tmp_path.glob("*.rrd"))) < parts:
            graph.wait(lambda: speaker.sent < graph.total("recorder", "clouds") + IN_FLIGHT, "recorded clouds")
            speaker.cloud(sketch=True)
            time.sleep(0.02)
        graph.reports("recorder", "frames_in", 2 * speaker.sent)
        graph.reports("recorder", "under_way", 0)

    record_until(2)
    before = speaker.sent
    speaker.describe(sensor.replace(range_offset_m=1.0))
    graph.wait(lambda: recorder.text.count("recording to") == 2, "the other recording")
    record_until(4)
    assert recorder.end(signal.SIGINT) == 0, recorder.text
    readers = {path: RecordingReader(path) for path in sorted(tmp_path.glob("*.rrd"))}
    recordings: dict[str, list] = {}
    for path, reader in readers.items():
        recordings.setdefault(reader.recording_id, []).append(path)
    first, second = recordings.values()
    stamps = [10**18 + k * 10**7 for k in range(speaker.sent)]
    assert (frames_of(*first), frames_of(*second)) == (stamps[:before], stamps[before:]) and len(first) >= 2
    assert [readers[paths[0]].properties()["sensor"]["range_offset_m"] for paths in (first, second)] == [0, 1]


def test_a_disk_that_is_full_is_one_error_and_the_recording_goes_on_in_a_new_file(graph, speaker, tmp_path):
    """The process may write no more, which to it is the same; ROS's own log goes to the standard output only."""
    recorder = graph.start("recorder", "--disable-external-lib-logs", path=tmp_path / "a.rrd", lossless=True).ready()
    speaker.ready()

    def record_until(condition, what: str):
        def step():
            speaker.cloud(sketch=True)
            time.sleep(0.02)        # clouds come at a sensor's rate
            return condition()
        return graph.wait(step, what)

    record_until(lambda: graph.total("recorder", "clouds") > 10, "clouds")
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
    record_until(lambda: graph.report("recorder").get("errors") == "1", "the error")
    report = record_until(lambda: (last := graph.report("recorder"))["level"] == DiagnosticStatus.ERROR
                          and "not_recorded" in last["message"] and last, "a report of frames that are not recorded")
    assert (report["errors"], report["last_error"]) == ("1", f"recording {tmp_path / 'a.rrd'}: File too large")
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    record_until(lambda: graph.report("recorder").get("path") == str(tmp_path / "a_2.rrd"), "the next file")
    record_until(lambda: graph.report("recorder")["level"] != DiagnosticStatus.ERROR, "an end of the errors")
    graph.reports("recorder", "frames_in", 2 * speaker.sent)
    assert recorder.end(signal.SIGTERM) == 0 and recorder.text.count("File too large") == 1
    assert graph.reports("recorder", "state", "finalized")["errors"] == "1"
    kept = frames_of(tmp_path / "a_2.rrd")
    assert len(kept) > 10 and kept[-1] == 10**18 + (speaker.sent - 1) * 10**7
    assert RecordingReader(tmp_path / "a_2.rrd").is_finished


def test_a_killed_recorder_leaves_a_file_that_repair_opens_with_all_but_the_end(graph, speaker, tmp_path):
    recorder = graph.start("recorder", path=tmp_path / "a.rrd", lossless=True).ready()
    speaker.ready()
    for sent in range(100):
        graph.wait(lambda: graph.total("recorder", "clouds") + IN_FLIGHT > sent, "recorded clouds")
        speaker.cloud(2000, sketch=True)

    def written() -> bool:
        (tmp_path / "seen.rrd").write_bytes((tmp_path / "a.rrd").read_bytes())
        with suppress(InvalidInput):            # in the middle of a chunk
            return len(frames_of(tmp_path / "seen.rrd")) == 100

    graph.wait(written, "all clouds in the file")
    recorder.kill()
    copy = repair(tmp_path / "a.rrd")
    reader = RecordingReader(copy)
    assert reader.is_finished and len(frames_of(copy)) == 100
    assert {name: len(one.values) for name, one in reader.series().items() if name != "drops"}.keys() >= {
        "points", "photons", "latency_ms"}


# ---- With the other nodes


def test_a_recording_has_all_that_the_nodes_published_said_and_were_told(graph, photon_file, events, tmp_path):
    path, frames = tmp_path / "a.rrd", 50           # of five topics: a lossless recorder keeps 256 messages
    path.write_bytes(b"an older one, to be replaced")
    clouds = graph.collect(PointCloud2, "points", raw=True)
    recorder = graph.start("recorder", path=path, colour_by="depth_std", lossless=True).ready()
    graph.start("reconstructor", fields="full", lossless=True).ready()
    graph.start("sketcher", lossless=True, sketch_size=7).ready()
    graph.start("player", input=photon_file, rate_hz=0, frames=frames, lossless=True, wait_for_subscribers=2)
    graph.wait(lambda: len(graph.all_reports("player")) > ASKED_TWICE, "reports of the player")
    assert graph.set("reconstructor", false_alarm_rate=0.002) == ""
    graph.collect(PointCloud2, "photons", raw=True)     # the second subscriber: it begins
    graph.wait(lambda: len(clouds) == frames, "every cloud")
    graph.reports("recorder", "clouds", frames)
    for name in ("sketcher", "reconstructor"):
        report = graph.reports(name, "frames_out", frames)
        assert (report["frames_in"], report["dropped"], report["message_lost"]) == (str(frames), "0", "0")
        assert int(report["photons"]) == frames * events.photons
    assert recorder.end(signal.SIGTERM) == 0 and "Warning" not in recorder.text, recorder.text
    last, reader = graph.reports("recorder", "state", "finalized"), RecordingReader(path)
    assert (last["errors"], last["recording_dropped"]) == ("0", "0")

    published = dict(points_message.decode_cdr(raw) for raw in clouds)
    published = {header.stamp_ns: columns for header, columns in published.items()}
    assert str(min(published)) == graph.report("player")["first_stamp_ns"]
    recorded = list(reader.clouds())
    assert len(recorded) == frames
    for cloud in recorded:
        columns = published[cloud.stamp_ns]
        assert sorted(map(bytes, cloud.xyz)) == sorted(map(bytes, columns["xyz"]))
        assert np.array_equal(np.sort(cloud.intensity), np.sort(columns["intensity"].astype(np.float16)))
        assert np.array_equal(np.sort(cloud.depth_std_m), np.sort(columns["depth_std"].astype(np.float16)))
    for name in ("/depth", "/intensity", "/background", "/photons"):
        assert len(list(reader.images(name))) >= frames - 1, name       # before it was seen to listen
    series = reader.series()
    assert {name: len(one.values) for name, one in series.items() if name != "drops"} == {
        "latency_ms": frames, "latency_sketch_ms": frames, "latency_reconstruct_ms": frames, "points": frames,
        "photons": frames, "ppp": frames, "frame_rate_hz": frames - 1}
    sketch, rest = series["latency_sketch_ms"].values, series["latency_reconstruct_ms"].values
    assert np.allclose(series["latency_ms"].values, sketch + rest) and (rest > 0).all()
    properties = reader.properties()
    parameters = properties["parameters"]
    assert parameters["sketcher.sketch_size"] == 7 and parameters["reconstructor.fields"] == "full"
    assert parameters["reconstructor.false_alarm_rate"] == 0.002 and parameters["recorder.colour_by"] == "depth_std"
    assert parameters["player.frames"] == frames and properties["run"]["namespace"] == graph.namespace
    assert properties["versions"]["rerun"] == "0.41.0" and properties["versions"]["ros_distro"] != "unknown"
    texts = [line.text for line in reader.log_lines()]
    assert {"sketcher: ready", "reconstructor: ready", "player: ready"} <= set(texts)
