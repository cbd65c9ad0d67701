"""Links and readers that do not keep up: frames are merged and rounded more coarsely, and no photon is lost."""

import dataclasses
import threading
import time

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2

from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sketch as sketch_message

FREQUENCIES = (1, 3)
PERIOD_S = 0.02


@pytest.fixture
def start(graph, sensor, events):
    """Starts a sketcher: (list of its sketches, what sends it so many frames at 1 / PERIOD_S or so)."""
    def start(**parameters) -> tuple:
        sketches = graph.collect(PointCloud2, "sketch")
        graph.start("sketcher", frequencies="1,3", **parameters).ready()
        graph.introduce(sensor)
        photons = graph.matched(graph.publisher(PointCloud2, "photons"))

        def send(frames: int) -> None:
            for _ in range(frames):
                photons.publish(photons_message.encode_cdr(
                    dataclasses.replace(events, stamp_ns=time.time_ns()), sensor, "spad"))
                time.sleep(PERIOD_S)

        return sketches, send

    return start


def sum_of(sketches, sensor) -> tuple[int, list[float]]:
    """Photons in all sketches, and the variances that rounding has added to each."""
    decoded = [sketch_message.decode_cdr(serialize_message(message), FREQUENCIES, sensor)[1] for message in sketches]
    return sum(int(sketch.photons.sum()) for sketch in decoded), [sketch.added_variance for sketch in decoded]


def test_above_max_mbit_s_frames_are_merged_and_rounded_more_coarsely_and_all_photons_arrive(graph, sensor, events,
                                                                                             start):
    sketches, send = start(layout="coded", max_mbit_s=0.04)     # a frame has 400 bytes or more: 12 a second
    send(60)
    report = graph.reports("sketcher", "photons", 60 * events.photons)      # also the last, which has no successor
    graph.wait(lambda: len(sketches) == int(report["frames_out"]), "the sketches")
    photons, variances = sum_of(sketches, sensor)
    assert photons == 60 * events.photons and len(sketches) < 40
    assert variances == sorted(variances) and max(variances) == pytest.approx(1.6**2 / 12)
    assert report["packets"] == "60" and report["coding_step_now"] == "1.6"

    assert graph.set("sketcher", max_mbit_s=0.0) == ""
    before = len(sketches)
    send(5)
    graph.wait(lambda: len(sketches) == before + 5, "a sketch for each frame again")
    assert sum_of(sketches[before:], sensor)[1] == [pytest.approx(0.4**2 / 12)] * 5

    assert graph.set("sketcher", max_mbit_s=0.001) == ""        # 8 s for a sketch
    send(3)
    graph.reports("sketcher", "under_way", 2)
    graph.processes[0].stop()
    graph.wait(lambda: len(sketches) == before + 7, "the sketch of the frames that waited")
    assert sum_of(sketches[before + 5:], sensor)[0] == 3 * events.photons


def test_for_a_reader_that_halts_frames_are_merged_until_it_goes_on(graph, sensor, events, start):
    sketches, send = start(max_mbit_s=1000.0)
    reader = graph.start("reconstructor").ready()
    graph.reports("reconstructor", "num_bins", sensor.num_bins)
    enough, sent = threading.Event(), []
    sender = threading.Thread(target=lambda: sent.extend(send(1) for _ in iter(enough.is_set, True)))
    sender.start()

    def wait_for_message(words: str) -> dict[str, str]:
        graph.wait(lambda: words in graph.report("sketcher").get("message", ""), f"{words!r} from the sketcher")
        return graph.report("sketcher")

    try:
        wait_for_message("frames/s in")
        reader.halt()
        degraded = wait_for_message("degraded, readers acknowledge late")
        reader.go_on()
        wait_for_message("frames/s in")
    finally:
        enough.set()
        sender.join()
    assert float(degraded["frames_per_sketch"]) > 1 and degraded["level"] == DiagnosticStatus.WARN
    report = graph.reports("sketcher", "packets", len(sent))
    graph.wait(lambda: len(sketches) == int(report["frames_out"]), "the sketches")
    assert sum_of(sketches, sensor)[0] == len(sent) * events.photons and report["dropped"] == "0"
