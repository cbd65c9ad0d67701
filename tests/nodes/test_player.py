"""The player alone: what it sends, when, and how it ends."""

import signal

import numpy as np
import pytest
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.messages import gates as gates_message
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sensor as sensor_message


def same_photons(one: PhotonEvents, other: PhotonEvents) -> bool:
    """True if both hold the same photons in any order."""
    return all(np.array_equal(*(part[np.lexsort((frame.toa, frame.pixel))] for part, frame in zip(parts, (one, other))))
               for parts in ((one.pixel, other.pixel), (one.toa, other.toa)))


def test_frames_come_stamped_on_schedule_and_the_player_ends_by_itself(graph, sensor, events, photon_file):
    frames, described = graph.collect(PointCloud2, "photons"), graph.collect_latched(String, "sensor")
    player = graph.start("player", input=photon_file, rate_hz=50, frames=5, frame_id="mast")
    assert player.code() == 0
    graph.wait(lambda: len(frames) == 5, "5 frames")
    sent = sensor_message.decode(described[0])
    assert sent.irf.tolist() == sensor.irf.tolist() and (sent.frame_id, sent.num_bins) == ("mast", 100)
    decoded = [photons_message.decode(frame, sent) for frame in frames]
    assert {header.frame_id for header, _ in decoded} == {"mast"}
    stamps = [header.stamp_ns for header, _ in decoded]
    assert np.diff(stamps).tolist() == [20_000_000] * 4
    assert all(same_photons(frame, events) for _, frame in decoded)
    report = graph.reports("player", "frames_sent", 5)
    assert int(report["first_stamp_ns"]) == stamps[0] and int(report["photons_sent"]) == 5 * events.photons


def test_gates_hold_the_same_photons(graph, events, photon_file):
    frames, described = graph.collect(Image, "gates"), graph.collect_latched(String, "sensor")
    assert graph.start("player", input=photon_file, output="gates", loop=False).code() == 0
    graph.wait(lambda: frames, "gates")
    sent = sensor_message.decode(described[0])
    _, gates = gates_message.decode(frames[0], sent)
    assert len(frames) == 1 and same_photons(gates.to_events(sent), events)


def test_the_simulator_is_played_with_its_parameters(graph):
    from srt3d_ros.datasets.simulator import Simulator
    frames, described = graph.collect(PointCloud2, "photons"), graph.collect_latched(String, "sensor")
    assert graph.start("player", ppp=0.5, sbr=2, seed=3, frames=2, rate_hz=100).code() == 0
    graph.wait(lambda: len(frames) == 2, "2 frames")
    sent: SensorModel = sensor_message.decode(described[0])
    simulator = Simulator(ppp=0.5, sbr=2.0, seed=3)
    assert sent.same_as(simulator.sensor)
    for k, message in enumerate(frames):
        assert same_photons(photons_message.decode(message, sent)[1], simulator.frame(k)[0])


def test_lossless_keeps_at_most_in_flight_frames_unanswered(graph, events, photon_file):
    frames = graph.collect(PointCloud2, "photons")
    answers = graph.publisher(PointCloud2, "points")
    player = graph.start("player", input=photon_file, lossless=True, rate_hz=0, in_flight=2, frames=6)

    def answer(frame):
        x = np.zeros((1, 16), np.uint8)
        message = PointCloud2(header=frame.header, height=1, width=1, point_step=16, row_step=16, is_dense=True)
        message.data = x.tobytes()
        answers.publish(message)

    for sent in (2, 3, 4, 5, 6):
        graph.wait(lambda: len(frames) == sent, f"frame {sent}")        # and not one more, or this would never hold
        answer(frames[sent - 2])
    assert player.running
    answer(frames[-1])
    assert player.code() == 0
    assert graph.report("player").get("unanswered") is None and points_message


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_it_waits_for_subscribers_ends_it_cleanly(graph, photon_file, number):
    player = graph.start("player", input=photon_file).says("waiting for 1 subscriber on ")
    assert graph.reports("player", "frames_out", 0)
    assert player.end(number) == 0
    assert "Traceback" not in player.text


@pytest.mark.parametrize("parameters, line", [
    ({"input": "nowhere.npz"}, "nowhere.npz"),
    ({"rate_hz": 0}, "rate_hz is 0.0: expected above 0 Hz"),
])
def test_what_cannot_be_played_is_one_line_and_exit_code_2(graph, parameters, line):
    player = graph.start("player", **parameters)
    assert player.code() == 2
    assert len(player.lines) == 1 and line in player.text
