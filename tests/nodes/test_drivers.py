"""The drivers in examples/: they publish, and Ctrl-C ends them between two callbacks, as it ends the nodes."""

import signal
import sys

import numpy as np
import pytest
from sensor_msgs.msg import Image
from std_msgs.msg import String

from examples.tmf8829_messages import decode
from srt3d_ros.messages import photon_frames, sensor_message
from tests.datasets import made_logs as made
from tools.processes import Process

# rclpy passes a signal on to the handler before its own, which raises KeyboardInterrupt by default: within rclpy, too.
PROGRAM = """
import pathlib, runpy, signal, sys
signal.signal(signal.SIGINT, lambda *_: print("interrupted"))
sys.argv = sys.argv[1:]
sys.path.insert(0, str(pathlib.Path(sys.argv[0]).parent))
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.fixture
def drive(graph, repository):
    """Starts a driver, and checks at the end that Ctrl-C ends it."""
    def drive(name: str, *arguments: str) -> Process:
        driver = Process([sys.executable, "-c", PROGRAM, str(repository / f"examples/{name}_driver.py"), *arguments,
                          "--ros-args", "-r", f"__ns:={graph.namespace}"])
        graph.processes.append(driver)
        return driver

    yield drive
    for driver in graph.processes:
        assert driver.end(signal.SIGINT) == 0, driver.text
        assert "interrupted" not in driver.text and "Traceback" not in driver.text


@pytest.mark.parametrize(("name", "topic"), [("histogram", "histograms"), ("spad", "gates")])
def test_a_driver_publishes_until_ctrl_c(graph, drive, name, topic):
    received = graph.collect(Image, topic, raw=True)
    drive(name)
    graph.wait(lambda: received, "a frame")


def test_measurements_of_a_tmf8829_are_published_and_bad_messages_are_a_line_each(graph, drive):
    """What the vendor's ZeroMQ publisher sends."""
    zmq = pytest.importorskip("zmq")
    zones = made.zones_16(np.linspace(1.0, 3.0, 16))
    sensors, frames = graph.collect_latched(String, "sensor"), graph.collect(Image, "histograms", raw=True)
    with zmq.Context() as context, context.socket(zmq.PUB) as publisher:
        driver = drive("tmf8829", f"tcp://127.0.0.1:{publisher.bind_to_random_port('tcp://127.0.0.1')}")
        for condition, message in ((lambda: sensors and frames, made.message(zones)),
                                   (lambda: "message is 8 bytes: expected a container" in driver.text, b"nonsense"),
                                   (lambda: "set histograms to 1" in driver.text, made.message(zones, parts=()))):
            # Again and again: a subscription takes a moment to reach its publisher.
            graph.wait(lambda message=message, condition=condition: publisher.send(message) or condition(), "it")
    expected = decode(made.message(zones), 0)
    sensor = sensor_message.from_json(sensors[0].data)
    assert len(sensors) == 1 and sensor.same_as(expected.sensor)        # the pulse has not moved
    header, received = photon_frames.HISTOGRAMS.decode_cdr(frames[0], sensor)
    assert header.frame_id == "tmf8829" and header.stamp_ns > 0
    assert (received.counts == expected.frame.counts).all()
