"""examples/record_bag.py: a bag of what drivers publish, which the readers of bags read."""

import signal
import sys

import numpy as np
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import PointCloud2

from srt3d_ros import read
from srt3d_ros.messages import sensor_message
from tools.processes import Process


def test_photons_and_the_latched_description_are_in_the_bag(graph, repository, sensor, events, photons_at, tmp_path):
    topics = [f"{graph.namespace}/{name}" for name in ("photons", "sensor")]
    described, photons = graph.latched("sensor"), graph.publisher(PointCloud2, "photons")
    described.publish(sensor_message.encode_cdr(sensor))        # before anybody listens
    command = [sys.executable, str(repository / "examples" / "record_bag.py"), str(tmp_path / "bag"), *topics]
    graph.processes.append(recorder := Process(command))
    recorder.says("waiting for")
    graph.matched(described)
    graph.matched(photons)
    for k in range(3):
        photons.publish(photons_at(k))
    assert described.wait_for_all_acked() and photons.wait_for_all_acked()
    assert recorder.end(signal.SIGINT) == 0
    assert f"{topics[0]}: 3 messages" in recorder.text and f"{topics[1]}: 1 messages" in recorder.text
    for k in range(3):
        found = read(tmp_path / "bag", k)
        assert found.sensor.same_as(sensor) and found.frame.stamp_ns == k
        assert np.array_equal(found.frame.pixel, events.pixel) and np.array_equal(found.frame.toa, events.toa)
    with Reader(tmp_path / "bag") as bag:       # as a player of bags sees it
        offered = {one.topic: one.ext.offered_qos_profiles[0].durability.name for one in bag.connections}
    assert offered == dict(zip(topics, ("VOLATILE", "TRANSIENT_LOCAL")))
