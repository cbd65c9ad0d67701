"""The device node: what a sensor's publisher sends, or a log has, comes on `sensor` and `histograms`."""

import socket

import numpy as np
import pytest
from sensor_msgs.msg import Image
from std_msgs.msg import String

from srt3d_ros.devices import tmf8829
from srt3d_ros.messages import histograms as histograms_message
from srt3d_ros.messages import sensor as sensor_message
from tests.devices import made

RANGES = np.linspace(1.0, 3.0, 16)
ZONES = made.zones_16(RANGES)


class Publisher:
    """A ZeroMQ publisher on a port of this machine, as the vendor's driver has one."""

    def __init__(self, port: int):
        zmq = pytest.importorskip("zmq")
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.PUB)
        self._socket.bind(f"tcp://127.0.0.1:{port}")
        self.send = self._socket.send

    def close(self) -> None:
        self._socket.close(0)
        self._context.term()


def test_a_device_that_goes_away_and_comes_back_is_followed_and_bad_messages_are_counted(graph):
    pytest.importorskip("zmq")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    sensors, frames = graph.collect_latched(String, "sensor"), graph.collect(Image, "histograms", raw=True)
    process = graph.start("device", connect=f"tcp://127.0.0.1:{port}").ready()
    graph.wait(lambda: f"waiting for tcp://127.0.0.1:{port}" in graph.report("device").get("message", ""), "a warning")

    def send_until(condition, message: bytes, what: str) -> None:
        """Send again and again: a subscription takes a moment to reach its publisher."""
        graph.wait(lambda: publisher.send(message) or condition(), what)

    for time in (1, 2):
        publisher = Publisher(port)
        try:
            graph.reports("device", "connections", time)
            before = len(frames)
            send_until(lambda: len(frames) > before, made.message(ZONES), "a frame")
            if time == 2:
                for cause, bad in (("malformed", b"nonsense"), ("no_histograms", made.message(ZONES, parts=()))):
                    send_until(lambda: graph.total("device", f"dropped.{cause}"), bad, f"a frame dropped as {cause}")
                assert graph.change("device", "deactivate") and graph.change("device", "activate")
                graph.reports("device", "connections", 3)
                before = len(frames)
                send_until(lambda: len(frames) > before, made.message(ZONES), "a frame of a node that is active again")
        finally:
            publisher.close()
        graph.reports("device", "disconnections", time)
        assert "which is gone" in graph.report("device")["message"]
    assert process.text.count("is connected") == 3 and process.text.count("is gone: waiting for it") == 2
    assert "message is 8 bytes: expected a container of the TMF8829 publisher" in process.text
    assert "set histograms to 1" in process.text and "Traceback" not in process.text
    sensor = sensor_message.decode(sensors[0])
    expected = tmf8829.decode(made.message(ZONES), 0)
    assert sensor.same_as(expected.sensor)
    header, received = histograms_message.decode_cdr(frames[0], sensor)
    assert header.frame_id == "tmf8829" and (received.counts == expected.frame.counts).all()


def test_a_log_is_played_once(graph, tmp_path):
    path = made.tmf8829_log(tmp_path / "log.json", [made.zones_16(RANGES + k) for k in (0, 1, 2)])
    sensors = graph.collect_latched(String, "sensor")
    frames = graph.collect(Image, "histograms", raw=True)
    process = graph.start("device", log=path, rate_hz=100.0, frame_id="tof").ready()
    assert process.code() == 0
    graph.wait(lambda: len(frames) == 3, "three frames")
    sensor, = map(sensor_message.decode, sensors)
    headers, received = zip(*(histograms_message.decode_cdr(raw, sensor) for raw in frames))
    assert [one.counts[0, 0].argmax() for one in received] == [12, 20, 28]
    stamps = [header.stamp_ns for header in headers]
    assert stamps == sorted(stamps) and {header.frame_id for header in headers} == {"tof"}
    assert "ranges count from the reference pulse" in process.text


def test_the_middle_of_a_log_is_broken(graph, tmp_path):
    path = made.tmf8829_log(tmp_path / "log.json", [made.zones_16(RANGES), made.zones_16(RANGES)])
    graph.collect(Image, "histograms", raw=True)
    path.write_text(path.read_text().replace('"ref_histo"', '"nothing"').replace('"nothing"', '"ref_histo"', 1))
    process = graph.start("device", log=path)
    assert process.code() == 1
    assert "log.json frame 1 is" in process.text and "Traceback" not in process.text
