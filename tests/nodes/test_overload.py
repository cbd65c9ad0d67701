"""Many times more photons than the machine can take: every packet is accounted for, the newest win, and it passes."""

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photons import PhotonEvents
from srt3d_ros.messages import cdr
from srt3d_ros.messages import photons as photons_message

PACKETS, SENT_AT_ONCE = 2, 400
S = 1_000_000_000
CALM_NS, OVERLOAD_NS, AFTER_NS = 1_000 * S, 2_000 * S, 3_000 * S    # far apart: each begins with a frame of its own


@pytest.fixture
def packet() -> tuple[SensorModel, bytes]:
    """100 × 100 pixels, so that a reconstruction takes many times as long as it takes to send its packets."""
    sensor = SensorModel(rows=100, cols=100, num_bins=200, bin_width_s=1e-10, irf=np.ones(3), frame_id="spad")
    pixel = np.repeat(np.arange(sensor.pixels, dtype=np.uint32), 8)
    toa = np.random.default_rng(0).normal(80, 2, len(pixel)).astype(np.uint16)
    return sensor, photons_message.encode_cdr(PhotonEvents(pixel, toa), sensor, "spad")


def test_overload_drops_the_oldest_counts_every_packet_and_passes(graph, packet):
    sensor, raw = packet
    clouds = graph.collect(PointCloud2, "points", raw=True)
    graph.start("reconstructor")
    graph.start("sketcher", packets_per_frame=PACKETS, sketch_size=5).ready()
    graph.introduce(sensor)
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    graph.reports("reconstructor", "num_bins", sensor.num_bins)
    sent = 0

    def send(first_ns: int, packets: int) -> None:
        nonlocal sent
        for k in range(packets):
            photons.publish(cdr.restamp(raw, first_ns + k * 1_000_000))
        sent += packets

    def stamps() -> list[int]:
        return [cdr.read_cloud(cloud).header.stamp_ns for cloud in clouds]

    def send_frames(first_ns: int, frames: int) -> None:
        """One frame after the other, each once the last one's cloud has come: none of these may be lost."""
        for frame in range(frames):
            stamp_ns = first_ns + frame * S // 10
            send(stamp_ns, PACKETS)
            graph.wait(lambda: stamps()[-1:] == [stamp_ns], f"the cloud of frame {frame} from {first_ns // S} s on")

    send_frames(CALM_NS, 3)
    calm = len(clouds)
    send(OVERLOAD_NS, SENT_AT_ONCE)
    graph.wait(lambda: len(clouds) > calm, "clouds in spite of the overload")
    send_frames(AFTER_NS, 5)            # the first frame after it already passes: it pushes out what still waits

    during = [stamp_ns for stamp_ns in stamps() if OVERLOAD_NS <= stamp_ns < AFTER_NS]
    assert 0 < len(during) < SENT_AT_ONCE // PACKETS and stamps() == sorted(stamps())

    def accounting() -> tuple[dict[str, int], dict[str, int]]:
        names = ("frames_in", "frames_out", "packets", "packets_open", "message_lost", "dropped", "errors")
        return tuple({name: graph.total(node, name) for name in names}
                     for node in ("sketcher", "reconstructor"))

    def balanced() -> bool:
        sketcher, reconstructor = accounting()
        return (sketcher["frames_in"] + sketcher["message_lost"] == sent
                and sketcher["frames_in"] == sketcher["packets"] + sketcher["packets_open"] + sketcher["dropped"]
                and sketcher["packets"] == PACKETS * sketcher["frames_out"]
                and reconstructor["frames_in"] + reconstructor["message_lost"] == sketcher["frames_out"]
                and reconstructor["frames_in"] == reconstructor["frames_out"] + reconstructor["dropped"]
                and reconstructor["frames_out"] == len(clouds))

    graph.wait(balanced, "counters that add up")
    sketcher, reconstructor = accounting()
    assert sketcher["errors"] == reconstructor["errors"] == 0
    causes = {node: {key for key in graph.report(node) if key.startswith("dropped.") and not key.endswith("_per_s")}
              for node in ("sketcher", "reconstructor")}
    assert causes["sketcher"] <= {"dropped.queue", "dropped.incomplete"}
    assert causes["reconstructor"] <= {"dropped.queue"}
