"""Stand-in for a reconstructor on a GPU: large clouds, with their sketches and images, prepared beforehand.

For each it reconstructs a small frame on the CPU, so that there is something for a recorder to slow down. As the
reconstructor does, it publishes images only to subscribers, and reports `reconstruct_ms`.
"""

import argparse
import sys
import time

from srt3d_ros.benchmark.frames import photons_of, sensor_of
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.messages import cdr
from srt3d_ros.messages import images as image_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.node_spec import NodeSpec
from srt3d_ros.nodes.runtime import run

SMALL, PPP, FREQUENCIES = 141, 15.0, 10


class StandIn(PipelineNode):
    """Publishes at a rate, from its worker."""

    spec = NodeSpec("standin", purpose="", outputs=(topics.SKETCH_SENSOR, topics.SKETCH, topics.POINTS,
                                                          *topics.IMAGES))
    side, rate_hz = 0, 0.0

    def configure(self) -> None:
        """Make the frames: one large cloud, whose sketch has a quarter of its pixels, and what is reconstructed."""
        small, half, large = (sensor_of(side) for side in (SMALL, self.side // 2, self.side))
        frequencies = choose("auto", small, FREQUENCIES)
        self._reconstruct, self._sketch = Pooled(small, frequencies), sketch_photons(photons_of(small, PPP), small,
                                                                                    frequencies)
        cloud: PointCloud = Pooled(large, frequencies)(sketch_photons(photons_of(large, PPP), large, frequencies))
        sketch = sketch_photons(photons_of(half, 4 * PPP), half, frequencies)
        self._prepared = {
            "sketch": sketch_message.encode_cdr(sketch, "spad"), "points": points_message.encode_cdr(cloud, "spad"),
            **{name: image_message.encode_cdr(image, 0, "spad") for name, image in (
                ("depth", cloud.depth_image(large.projection)), ("intensity", cloud.image("intensity")),
                ("background", cloud.background))}}
        self._outgoing = {name: self.advertise(name) for name in self._prepared}
        self._description = self.advertise("sketch/sensor")
        self._description.publish(sketch_message.encode_sensor(half, frequencies, 1))

    def activate(self) -> None:
        """Begin."""
        self.create_timer(1 / self.rate_hz, lambda: self.worker.call(self._frame))

    def _frame(self) -> None:
        stamp_ns = self.now_ns()
        self.diagnostics.received()
        for name, publisher in self._outgoing.items():
            if name == "points":
                started = time.perf_counter()
                self._reconstruct(self._sketch)
            if name in ("sketch", "points") or publisher.get_subscription_count():
                publisher.publish(cdr.restamp(self._prepared[name], stamp_ns))
            if name == "points":
                self.diagnostics.show(reconstruct_ms=f"{(time.perf_counter() - started) * 1e3:.2f}")
                self.sent(stamp_ns)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--side", type=int, required=True)
    parser.add_argument("--rate-hz", type=float, required=True)
    given = parser.parse_args()
    StandIn.side, StandIn.rate_hz = given.side, given.rate_hz
    sys.exit(run(StandIn, []))
