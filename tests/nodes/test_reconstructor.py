"""The reconstructor alone: clouds, images on demand, bad messages, devices."""

import dataclasses

import numpy as np
import pytest
import torch
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger

from srt3d_ros.core.distortion import PlumbBob
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.projection import AngularScan
from srt3d_ros.core.scan_rate import ScanRate
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets.scene import NetScene, StaticScene, net_sensor
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.messages import images as image_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes.topics import LATCHED
from tests.nodes.conftest import check_outdated

STAMP_NS = 1_700_000_000_123_456_789


def decode_points(cloud: PointCloud2):
    return points_message.decode_cdr(serialize_message(cloud))


def decode_image(image: Image):
    return image_message.decode_cdr(serialize_message(image))


@pytest.fixture(scope="session")
def sensor(sensor):
    """Its rows look one after the other."""
    return sensor.replace(scan=ScanRate(row_period_s=0.001, col_period_s=0.0001))


@pytest.fixture
def sketch(sensor, events):
    """The sketch of the plane at bin 50."""
    return sketch_photons(dataclasses.replace(events, stamp_ns=STAMP_NS), sensor, choose("auto", sensor, 10))


@pytest.fixture
def send(graph, sensor, sketch):
    """Sends the description, then, once it has arrived, whatever it is given."""
    graph.node.create_publisher(String, "sketch/sensor", LATCHED).publish(
        sketch_message.encode_sensor(sensor, sketch.frequencies, 1))
    publisher = graph.publisher(PointCloud2, "sketch")

    def send(*messages):
        graph.reports("reconstructor", "rows", sensor.rows)
        graph.matched(publisher)
        for message in messages:
            publisher.publish(message)

    return send


@pytest.fixture
def setting(graph):
    """Sets parameters together, as `ros2 param set` does one; the reason why not, or an empty text."""
    def setting(**values) -> str:
        given = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        request = SetParametersAtomically.Request(parameters=given)
        result = graph.call(SetParametersAtomically, "reconstructor/set_parameters_atomically", request).result
        assert result.successful == (not result.reason)
        return result.reason

    return setting


def test_a_cloud_keeps_stamp_and_frame_and_lies_on_the_plane_and_bad_sketches_are_survived(graph, sensor, sketch, send):
    clouds = graph.collect(PointCloud2, "points")
    process = graph.start("reconstructor", lossless=True, fields="full").ready()
    good = sketch_message.encode_cdr(sketch, "spad")
    small = dataclasses.replace(sketch, sums=sketch.sums[:8], photons=sketch.photons[:8])
    send(good[:200], sketch_message.encode_cdr(small, "spad"), good)
    graph.wait(lambda: clouds, "the cloud of the good sketch")
    header, points = decode_points(clouds[0])
    assert (header.stamp_ns, header.frame_id) == (STAMP_NS, "spad")
    assert len(points["xyz"]) > 0.9 * sensor.pixels
    ranges = np.linalg.norm(points["xyz"], axis=1)
    assert abs(np.median(ranges) - sensor.range_m(50)) < sensor.range_m(1) - sensor.range_m(0)
    report = graph.reports("reconstructor", "frames_out", 1)
    assert (report["frames_in"], report["dropped.malformed"], report["dropped"]) == ("3", "2", "2")
    assert int(report["photons"]) == sketch.photons.sum() and int(report["points"]) == len(ranges)
    assert report["device"] == ("cuda" if torch.cuda.is_available() else "cpu")
    assert process.text.count("no CUDA device: computing on the CPU") == (not torch.cuda.is_available())
    assert "Traceback" not in process.text


def test_images_are_published_while_somebody_subscribes(graph, sensor, sketch, send):
    clouds = graph.collect(PointCloud2, "points")
    process = graph.start("reconstructor", lossless=True).ready()
    message = sketch_message.encode_cdr(sketch, "spad")
    send(message)
    graph.wait(lambda: len(clouds) == 1, "a cloud")
    images = {name: graph.collect(Image, name) for name in ("depth", "intensity", "background")}
    cameras = graph.collect(CameraInfo, "camera_info")

    def complete():
        send(message)
        return cameras and all(images.values())

    graph.wait(complete, "all images")
    decoded = {name: decode_image(received[0]) for name, received in images.items()}
    assert all(header.stamp_ns == STAMP_NS and header.frame_id == "spad" for header, _ in decoded.values())
    assert {image.shape for _, image in decoded.values()} == {(16, 12)}
    assert abs(np.nanmedian(decoded["depth"][1]) - sensor.range_m(50)) < sensor.range_m(1) - sensor.range_m(0)
    assert (cameras[0].height, cameras[0].width, cameras[0].header.frame_id) == (16, 12, "spad")
    assert process.running


def test_upsampling_gives_points_and_images_of_finer_pixels(graph, sensor, sketch, send):
    clouds = graph.collect(PointCloud2, "points")
    depths, cameras = graph.collect(Image, "depth"), graph.collect(CameraInfo, "camera_info")
    graph.start("reconstructor", lossless=True, fields="full", upsampling=3).ready()
    message = sketch_message.encode_cdr(sketch, "spad")

    def complete():
        send(message)
        return clouds and depths and cameras

    graph.wait(complete, "a cloud, a depth image and its camera")
    points, depth_m = decode_points(clouds[0])[1], decode_image(depths[0])[1]
    finer = sensor.upsampled(3)
    assert (points["row"].max(), points["col"].max()) == (finer.rows - 1, finer.cols - 1)
    directions = points["xyz"] / np.linalg.norm(points["xyz"], axis=1, keepdims=True)
    np.testing.assert_allclose(directions, finer.rays[points["row"], points["col"]], atol=1e-5)
    np.testing.assert_allclose(points["t"], finer.pixel_times_s[points["row"], points["col"]], atol=1e-9)
    assert depth_m.shape == (finer.rows, finer.cols)
    assert (cameras[0].height, cameras[0].width) == depth_m.shape
    assert (cameras[0].k[0], cameras[0].k[2]) == (finer.projection.fx, finer.projection.cx)


def test_points_and_images_agree_on_what_is_within_the_limits(graph, sensor, sketch, send, setting):
    clouds = graph.collect(PointCloud2, "points")
    images = {name: graph.collect(Image, name) for name in ("depth", "intensity")}
    graph.start("reconstructor", lossless=True, organised=True).ready()
    message = sketch_message.encode_cdr(sketch, "spad")

    def frame() -> tuple[PointCloud2, np.ndarray, np.ndarray]:
        before = len(clouds)
        send(message)
        graph.wait(lambda: len(clouds) > before and {len(clouds)} == set(map(len, images.values())), "a frame")
        return clouds[-1], *(decode_image(kept[-1])[1] for kept in images.values())

    whole, depth_m, intensity = frame()
    assert (whole.height, whole.width) == (16, 12)
    seen = np.isfinite(depth_m)
    assert whole.is_dense == seen.all() and (np.isfinite(intensity) == seen).all()
    range_m = depth_m / sensor.rays[..., 2]
    middle_m = float(np.nanmedian(range_m))
    assert setting(min_range_m=0.5, max_range_m=middle_m, fields="full") == ""
    near, depth_m, intensity = frame()
    points = decode_points(near)[1]
    assert 0.2 * sensor.pixels < len(points["xyz"]) < 0.8 * sensor.pixels and not near.is_dense
    assert np.linalg.norm(points["xyz"], axis=1).max() <= middle_m * (1 + 1e-6)
    for image, column in ((depth_m, points["xyz"][:, 2]), (intensity, points["intensity"])):
        assert np.isfinite(image).sum() == len(column) and (image[points["row"], points["col"]] == column).all()
    assert setting(organised=False, min_range_m=middle_m, max_range_m=0.0) == ""
    far = frame()[0]
    assert (far.height, far.width, far.is_dense) == (1, int(seen.sum()) - len(points["xyz"]), True)
    assert int(graph.reports("reconstructor", "frames_out", 3)["points_out_of_range"]) == int(seen.sum())


def test_images_and_organised_clouds_show_the_surface_that_surface_order_puts_first(graph, setting):
    clouds, depths = graph.collect(PointCloud2, "points"), graph.collect(Image, "depth")
    publisher, net = graph.publisher(PointCloud2, "sketch"), net_sensor()
    graph.start("reconstructor", lossless=True, surfaces=2, organised=True).ready()
    sketch = sketch_photons(Simulator(NetScene(net), net, sbr=3, ppp=100).frame(0)[0], net, choose("auto", net, 10))
    graph.node.create_publisher(String, "sketch/sensor", LATCHED).publish(
        sketch_message.encode_sensor(net, sketch.frequencies, 1))
    graph.reports("reconstructor", "num_bins", net.num_bins)
    graph.matched(publisher)
    shown = {}
    for frames, order in enumerate(("strongest", "nearest", "farthest"), start=1):
        assert order == "strongest" or setting(surface_order=order) == ""
        publisher.publish(sketch_message.encode_cdr(sketch, "spad"))
        graph.wait(lambda: len(clouds) == len(depths) == frames, f"a frame, the {order} surfaces first")
        shown[order] = depth_m = decode_image(depths[-1])[1]
        assert (decode_points(clouds[-1])[1]["xyz"][:, 2] == depth_m[np.isfinite(depth_m)]).all()
    strongest, nearest, farthest = shown.values()
    both = nearest < farthest
    assert both.sum() > 700
    assert np.median(nearest[both]) == pytest.approx(NetScene.net_m, abs=0.03)
    assert np.median(farthest[both]) == pytest.approx(NetScene.plane_m, abs=0.03)
    assert (nearest[both] < 2.6).all() and (farthest[both] > 2.6).all()
    from_net = strongest == nearest
    assert (from_net | (strongest == farthest))[both].all() and 200 < from_net[both].sum() < both.sum() - 200
    assert setting(surface_order="first") == "surface_order is first: expected strongest or nearest or farthest"


def test_parameters_are_refused_with_the_reason_or_change_between_frames_and_no_frame_is_lost(graph, sensor, sketch,
                                                                                              send, setting):
    clouds = graph.collect(PointCloud2, "points")
    graph.start("reconstructor", lossless=True, max_range_m=4.0).ready()
    assert setting(min_range_m=4.0) == "min_range_m is 4.0: expected less than max_range_m, 4 m"
    assert setting(min_range_m=-1.0).startswith("min_range_m is -1.0: expected a number of 0 or more m")
    assert setting(method="smle", warm_start=True) == "warm_start is True: expected False, as smle has no such option"
    assert setting(method="rt3d").startswith("method is rt3d: expected ")
    assert setting(save_format="las") == "save_format is las: expected ply or pcd or npz"
    if not torch.cuda.is_available():
        assert setting(device="cuda").startswith("device is cuda: expected ")
    assert setting(min_range_m=4.5, max_range_m=5.0) == "" and setting(min_range_m=0.0, fields="full") == ""
    expected = []
    for at, change in enumerate(({}, {"pipeline": "throughput", "background": "flat"},
                                 {"method": "smle", "background": "auto"}, {"method": "srt3d",
                                  "weighting": "precision"}, {"method": "pooled", "weighting": "auto",
                                                              "pipeline": "latency"})):
        assert not change or setting(**change) == ""
        for stamp_ns in range(STAMP_NS + 4 * at, STAMP_NS + 4 * at + 4):
            send(sketch_message.encode_cdr(dataclasses.replace(sketch, stamp_ns=stamp_ns), "spad"))
        send(sketch_message.encode_cdr(sketch, "spad")[:200])
        graph.wait(lambda: len(clouds) == 4 * at + 4, f"the clouds of {change}")
        graph.reports("reconstructor", "dropped.malformed", at + 1)
        points = decode_points(clouds[-1])[1]
        ranges = np.linalg.norm(points["xyz"], axis=1)
        assert len(ranges) > 0.8 * sensor.pixels
        assert abs(np.median(ranges) - sensor.range_m(50)) < sensor.range_m(1) - sensor.range_m(0)
        expected.append(points["intensity"].tolist())
    assert expected[0] == expected[4] != expected[2] != expected[3]
    assert [decode_points(cloud)[0].stamp_ns for cloud in clouds] == list(range(STAMP_NS, STAMP_NS + 20))
    report = graph.reports("reconstructor", "frames_out", 20)
    assert (report["frames_in"], report["dropped"], report["errors"]) == ("25", "5", "0")


@pytest.mark.parametrize("given, line", [
    ({"min_range_m": 3.0, "max_range_m": 2.0}, "min_range_m is 3.0: expected less than max_range_m, 2 m"),
    ({"pipeline": "fast"}, "pipeline is fast: expected latency or throughput"),
])
def test_parameters_that_cannot_be_used_are_one_line_and_exit_code_2(graph, given, line):
    process = graph.start("reconstructor", **given)
    assert (process.code(), process.lines) == (2, [line])


def test_a_reset_makes_the_next_frame_a_first_one(graph, sensor, sketch, send):
    clouds = graph.collect(PointCloud2, "points")
    graph.start("reconstructor", lossless=True, warm_start=True, fields="full").ready()
    message = sketch_message.encode_cdr(sketch, "spad")
    for frames in range(1, 5):
        send(message)
        graph.wait(lambda: len(clouds) == frames, "a cloud")
        if frames == 2:
            assert graph.call(Trigger, "reconstructor/reset", Trigger.Request()).success
    intensity = [decode_points(cloud)[1]["intensity"].tolist() for cloud in clouds]
    assert intensity[0] == intensity[2] and intensity[1] == intensity[3] and intensity[0] != intensity[1]


def test_the_newest_cloud_is_saved_where_and_as_what_the_parameters_say(graph, sensor, sketch, send, setting, tmp_path):
    clouds, folder = graph.collect(PointCloud2, "points"), tmp_path / "clouds"
    folder.mkdir()
    graph.start("reconstructor", lossless=True, save_folder=folder, frame_id="rig").ready()

    def save() -> tuple[bool, str]:
        answer = graph.call(Trigger, "reconstructor/save_cloud", Trigger.Request())
        return answer.success, answer.message

    assert save() == (False, f"no cloud to save yet: no sketch has arrived on {graph.namespace}/sketch")
    send(sketch_message.encode_cdr(sketch, "spad"))
    graph.wait(lambda: clouds, "a cloud")
    xyz = decode_points(clouds[0])[1]["xyz"]
    name = f"cloud_{STAMP_NS}"
    assert save() == (True, f"{len(xyz)} points saved as {folder / name}.ply")
    assert save() == (True, f"{len(xyz)} points saved as {folder / name}_2.ply")
    assert setting(save_format="npz") == "" and save()[0]
    assert (np.load(folder / f"{name}.npz")["xyz"] == xyz).all()
    assert sorted(path.name for path in folder.iterdir()) == [f"{name}.npz", f"{name}.ply", f"{name}_2.ply"]
    header = (folder / f"{name}.ply").read_bytes().split(b"end_header")[0].decode()
    assert f"element vertex {len(xyz)}" in header and "in the frame rig" in header
    assert "read-only" in setting(save_folder=str(tmp_path))      # where, says who starts the node
    folder.rename(tmp_path / "moved")
    success, why = save()
    assert not success and why.startswith(f"output is {str(tmp_path)[:20]}") and len(why.splitlines()) == 1
    assert graph.call(Trigger, "reconstructor/reset", Trigger.Request()).success
    assert save()[1].startswith("no cloud to save yet")
    off = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_DEACTIVATE))
    assert graph.call(ChangeState, "reconstructor/change_state", off).success
    name = f"{graph.namespace}/reconstructor"
    assert save() == (False, f"{name} is inactive: ros2 lifecycle set {name} activate")


def test_a_lens_bends_the_rays_and_is_told_beside_the_images_and_a_scanner_has_ranges_and_no_camera(graph, sensor,
                                                                                                    sketch):
    clouds, depths = graph.collect(PointCloud2, "points"), graph.collect(Image, "depth")
    cameras, publisher = graph.collect(CameraInfo, "camera_info"), graph.publisher(PointCloud2, "sketch")
    describe = graph.node.create_publisher(String, "sketch/sensor", LATCHED)
    graph.start("reconstructor", lossless=True, fields="full").ready()
    lens = dataclasses.replace(sensor.projection, distortion=PlumbBob(-0.3, 0.1, 0.001, -0.002, 0.0))
    scan = AngularScan(0.5, -0.1, 0.4, -0.05)
    for frames, projection in enumerate((lens, scan), start=1):
        other = sensor.replace(projection=projection, num_bins=sensor.num_bins + frames)
        describe.publish(sketch_message.encode_sensor(other, sketch.frequencies, 1))
        graph.reports("reconstructor", "num_bins", other.num_bins)
        graph.matched(publisher).publish(sketch_message.encode_cdr(sketch, "spad"))
        graph.wait(lambda: len(clouds) == len(depths) == frames and cameras, "a cloud, a depth image and a camera")
        points, depth_m = decode_points(clouds[-1])[1], decode_image(depths[-1])[1]
        range_m = np.linalg.norm(points["xyz"], axis=1)
        directions = points["xyz"] / range_m[:, None]
        np.testing.assert_allclose(directions, other.rays[points["row"], points["col"]], atol=1e-6)
        expected_m = range_m if projection is scan else points["xyz"][:, 2]
        np.testing.assert_allclose(depth_m[points["row"], points["col"]], expected_m, rtol=1e-6)
    assert graph.reports("reconstructor", "frames_out", 2) and len(cameras) == 1
    assert list(cameras[0].d) == [-0.3, 0.1, 0.001, -0.002, 0.0]
    assert np.abs(sensor.replace(projection=lens).rays - sensor.rays).max() > 1e-3


def test_sketches_that_another_description_overtakes_are_read_with_their_own_and_counted(graph, sensor, sketch):
    """The same rows, columns and m, but another T: read with the new description they would be other depths."""
    descriptions = graph.node.create_publisher(String, "sketch/sensor", LATCHED)
    sketches, clouds = graph.publisher(PointCloud2, "sketch"), graph.collect(PointCloud2, "points")
    check_outdated(
        graph, "reconstructor", "overtaken", frames=sketches, made=clouds, old=sensor, new=sensor.replace(num_bins=128),
        describe=lambda described: descriptions.publish(
            sketch_message.encode_sensor(described, sketch.frequencies, 1)),
        send=lambda: sketches.publish(sketch_message.encode_cdr(sketch, "spad")))


def test_fog_is_taken_out_and_log_and_diagnostics_say_so(graph, sensor, sketch, send):
    clouds, slope = graph.collect(PointCloud2, "points"), np.tile(40 + 3.0 * np.arange(sensor.cols), (sensor.rows, 1))
    process = graph.start("reconstructor", lossless=True, fields="full")
    process.ready()

    def see(background_shape, frames: int) -> dict[str, str]:
        """The diagnostics after some more frames."""
        seen = sensor.replace(background_shape=background_shape, gates=None)
        simulator = Simulator(StaticScene(seen.range_m(slope)), seen, sbr=0.5, ppp=60)
        before = len(clouds)
        for k in range(frames):
            send(sketch_message.encode_cdr(sketch_photons(simulator.frame(k)[0], sensor, sketch.frequencies), "spad"))
            graph.wait(lambda k=k: len(clouds) == before + k + 1, "a cloud")
        return graph.reports("reconstructor", "frames_out", len(clouds))

    assert see(None, 2)["background_unevenness"] == "0.0000"
    shown = see(np.exp(-np.arange(sensor.num_bins) / 10), 4)
    assert float(shown["background_unevenness"]) > 0.2 and 0.55 < float(shown["background_share"]) < 0.8
    process.says("the background is uneven")
    points = decode_points(clouds[-1])[1]
    range_m = np.linalg.norm(points["xyz"], axis=1)
    assert np.abs(range_m - sensor.range_m(slope[points["row"], points["col"]])).max() < 5 * sensor.bin_width_m
    assert see(None, 4)["background_unevenness"] == "0.0000"
    process.says("the background is even")
