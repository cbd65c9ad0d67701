"""Faults of each kind while nodes run: right clouds come back, recordings too, and nothing grows over time."""

import signal
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from sensor_msgs.msg import PointCloud2

from srt3d_ros.messages import points_message as points
from srt3d_ros.messages import sensor_message
from srt3d_ros.recording.reader import RecordingReader

NODES = ("sketcher", "reconstructor", "recorder")
GROWTH = 1.1        # of a node's memory: rerun's buffers and the allocator's pools still fill up
MB = 1e6


class Pipeline:
    """Three running nodes. The test is the driver: it sends a plane at depth bin 50 (`events`)."""

    def __init__(self, graph, sensor, photons_at, folder: Path):
        self.graph, self.sensor, self.folder = graph, sensor, folder
        self._photons_at = photons_at
        self._range_m = np.median(sensor.range_m(np.full(1, 50.0, np.float32)))
        self.processes: dict = {}
        for name in NODES:
            self.start(name)
        self._description, self._photons = graph.latched("sensor"), graph.publisher(PointCloud2, "photons")
        self._clouds = graph.collect(PointCloud2, "points", raw=True)
        self._description.publish(sensor_message.encode_cdr(sensor))

    def start(self, name: str) -> None:
        parameters = {"path": self.folder / "a.rrd"} if name == "recorder" else {}
        self.processes[name] = self.graph.start(name, **parameters).ready()

    def send(self, stamp_ns: int = 0) -> int:
        stamp_ns = stamp_ns or time.time_ns()
        self._photons.publish(self._photons_at(stamp_ns))
        return stamp_ns

    def recovers(self, after_ns: int = 0) -> None:
        """Send frames until one of them has come back as a cloud of the plane; every cloud must show the plane."""
        sent = set()

        def back() -> bool:
            sent.add(self.send(after_ns and after_ns + len(sent)))
            time.sleep(0.1)
            headers = [points.decode_cdr(raw) for raw in self._clouds]
            clouds = {header.stamp_ns: columns["xyz"] for header, columns in headers}
            for xyz in clouds.values():
                assert abs(np.median(np.linalg.norm(xyz, axis=1)) - self._range_m) < self.sensor.bin_width_m
            return any(len(clouds[stamp]) > 0.9 * self.sensor.pixels for stamp in sent & clouds.keys())

        self.graph.wait(back, "a cloud of a frame sent after the fault")


@pytest.fixture(scope="module")
def pipeline(shared_graph, sensor, photons_at, tmp_path_factory):
    pipeline = Pipeline(shared_graph, sensor, photons_at, tmp_path_factory.mktemp("recording"))
    pipeline.recovers()
    return pipeline


@pytest.mark.parametrize("name", NODES)
def test_clouds_come_back_after_a_node_is_killed_and_started_again(pipeline, name):
    pipeline.processes[name].kill()
    pipeline.start(name)
    pipeline.recovers()


def test_clouds_come_back_after_stamps_that_leap_and_a_reader_that_stops(pipeline):
    pipeline.recovers(after_ns=1_000_000_000)       # decades back
    pipeline.processes["recorder"].pause()
    pipeline.recovers(after_ns=time.time_ns())
    pipeline.processes["recorder"].resume()


def test_nothing_that_the_nodes_hold_grows(pipeline, rounds):
    """Two equal runs of `rounds` frames; the first also warms up. A leak would be one file or thread for each frame.

    The pool of threads of rerun, each with files, may still fill up.
    """
    def held() -> dict[str, tuple[float, int, int]]:
        for _ in range(rounds):
            pipeline.send()
            time.sleep(0.05)
        processes = {name: psutil.Process(process.pid) for name, process in pipeline.processes.items()}
        return {name: (one.memory_info().rss / MB, one.num_fds(), one.num_threads()) for name, one in processes.items()}

    held()
    before, after, allowed = held(), held(), rounds / 2
    for name in NODES:
        (memory, files, threads), then = after[name], before[name]
        assert memory < GROWTH * then[0], (name, before, after)
        assert files < then[1] + allowed and threads < then[2] + allowed, (name, before, after)

    def recorded() -> bool:         # on a busy machine most frames are dropped
        pipeline.send()
        return pipeline.graph.total("recorder", "clouds") > rounds

    pipeline.graph.wait(recorded, f"more than {rounds} clouds in the recording")
    pipeline.processes["recorder"].end(signal.SIGTERM)
    newest = max(pipeline.folder.glob("*.rrd"))         # after the kill: a_2.rrd
    assert len(RecordingReader(newest).index) > rounds
