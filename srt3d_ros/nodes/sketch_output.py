"""What the sketcher publishes: `sketch`, and before the first sketch that needs it its description, `sketch/sensor`."""

from srt3d_ros.core.gate import in_ranges
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.window import WindowSketcher
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.diagnostics import all_acknowledged
from srt3d_ros.nodes.sensor_choice import in_words

ANNOUNCE_S = 0.2            # for a description to arrive before the first sketch that needs it


class SketchOutput:
    """Publishes the sketches of `node`, in the layout of its parameters."""

    def __init__(self, node: PipelineNode):
        self._node = node
        self._sketches = node.advertise("sketch")
        self._sketch_sensor = node.advertise("sketch/sensor")
        self._described: WindowSketcher | None = None       # whose sketches sketch/sensor describes

    def describe(self, sketcher: WindowSketcher) -> None:
        """Publish the description of a sketcher's sketches."""
        node, gate, frames = self._node, sketcher.gate, sketcher.window_frames
        sensor = gate.sensor if gate else sketcher.sensor
        self._sketch_sensor.publish(sketch_message.encode_sensor(sensor, sketcher.frequencies, frames))
        self._described = sketcher
        node.diagnostics.show(rows=sensor.rows, cols=sensor.cols, num_bins=sensor.num_bins, window_frames=frames,
                              frequencies=" ".join(map(str, sketcher.frequencies)), gate=in_ranges(gate))
        node.release_frames()

    def publish(self, sketch: Sketch, frame_id: str, sketcher: WindowSketcher, design: str,
                packets: int, photons: int) -> None:
        """Publish a frame of so many packets and photons, if need be after the description of its sketcher's sketches,
        whose design is in these words.

        Raises:
            InvalidInput: the sketch is not one of photons.
        """
        values = self._node.parameters
        data = sketch_message.encode_cdr(sketch, values["frame_id"] or frame_id, values["layout"],
                                         values["coding_step"])
        if self._described is not sketcher:
            self._announce(sketcher, design)
        self._node.publish_frame(self._sketches, data, sketch.stamp_ns, packets=packets, photons=photons)

    def _announce(self, sketcher: WindowSketcher, design: str) -> None:
        """Describe the sketches that begin now: after the last of the old ones has been read, if readers keep up."""
        self.describe(sketcher)
        sensor = sketcher.gate.sensor if sketcher.gate else sketcher.sensor
        self._node.get_logger().info(f"sketches of {in_words(sensor)}: {design}")
        self._node.wait_until(lambda: all_acknowledged(self._sketch_sensor), "sketch/sensor to arrive", ANNOUNCE_S)
