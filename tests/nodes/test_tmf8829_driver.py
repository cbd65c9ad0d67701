"""examples/tmf8829_driver.py: what the vendor's ZeroMQ publisher sends comes on `sensor` and `histograms`."""

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


def test_measurements_are_published_and_bad_messages_are_a_line_each(graph, repository):
    zmq = pytest.importorskip("zmq")
    zones = made.zones_16(np.linspace(1.0, 3.0, 16))
    sensors, frames = graph.collect_latched(String, "sensor"), graph.collect(Image, "histograms", raw=True)
    with zmq.Context() as context, context.socket(zmq.PUB) as publisher:
        address = f"tcp://127.0.0.1:{publisher.bind_to_random_port('tcp://127.0.0.1')}"
        driver = Process([sys.executable, str(repository / "examples/tmf8829_driver.py"), address,
                          "--ros-args", "-r", f"__ns:={graph.namespace}"])
        graph.processes.append(driver)
        for condition, message in ((lambda: sensors and frames, made.message(zones)),
                                   (lambda: "message is 8 bytes: expected a container" in driver.text, b"nonsense"),
                                   (lambda: "set histograms to 1" in driver.text, made.message(zones, parts=()))):
            # Again and again: a subscription takes a moment to reach its publisher.
            graph.wait(lambda message=message, condition=condition: publisher.send(message) or condition(), "it")
    assert driver.end(signal.SIGINT) == 0 and "Traceback" not in driver.text
    expected = decode(made.message(zones), 0)
    sensor = sensor_message.from_json(sensors[0].data)
    assert len(sensors) == 1 and sensor.same_as(expected.sensor)        # the pulse has not moved
    header, received = photon_frames.HISTOGRAMS.decode_cdr(frames[0], sensor)
    assert header.frame_id == "tmf8829" and header.stamp_ns > 0
    assert (received.counts == expected.frame.counts).all()
