"""sketcher: `photons` or `gates` → `sketch`. Keeps m complex numbers a pixel instead of the photons."""

import sys
from collections import deque
from functools import reduce
from operator import add

import numpy as np
from std_msgs.msg import String

from srt3d_ros.core.frequencies import DEFAULT_SKETCH_SIZE, RULES, choose
from srt3d_ros.core.photons import TOA_DTYPES, PhotonEvents, PhotonGates
from srt3d_ros.core.sensor import MAX_BINS, GateWords, SensorModel
from srt3d_ros.core.sketch import MAX_SKETCH_SIZE, Sketch
from srt3d_ros.core.sketching import Sketcher
from srt3d_ros.messages import gates as gates_message
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.interface import LOSSLESS, Interface, Service
from srt3d_ros.nodes.parameters import Parameter
from srt3d_ros.nodes.runtime import run
from srt3d_ros.nodes.worker import Dropped

PARAMETERS = (
    Parameter("sketch_size", DEFAULT_SKETCH_SIZE, "Complex numbers kept for each pixel, unless `frequencies` lists "
              "them.", low=1, high=MAX_SKETCH_SIZE),
    Parameter("frequencies", "auto", "Which frequencies to keep: those with the least expected depth error for the "
              "IRF, spread to where the IRF passes 0.35, 1 to sketch_size as in the paper, or these.",
              form="auto, spread, consecutive or integers such as 1,2,5"),
    Parameter("packets_per_frame", 1, "Messages that make one frame.", low=1, high=100_000),
    Parameter("window_frames", 1, "Frames that each sketch covers, the newest and those before it: a sliding window.",
              low=1, high=1000),
    Parameter("layout", "float32", "Type of the sketch on the wire; int16 halves the bandwidth.",
              choices=("float32", "int16")),
    Parameter("frame_id", "", "tf frame of what is published; the messages' own if empty.", live=True),
    LOSSLESS,
)

INTERFACE = Interface(
    "sketcher",
    purpose="Keeps, of each pixel's photons, their number and m complex numbers: a sketch. It is as large for a "
    "billion photons as for one, and enough to reconstruct from. Put it beside the sensor, and send sketches on.",
    inputs=(topics.SENSOR, topics.PHOTONS, topics.GATES),
    outputs=(topics.SKETCH_SENSOR, topics.SKETCH),
    services=(Service("reset", "forget the photons of the frame and of the window under way"),),
    parameters=PARAMETERS,
    limits=("`photons` and `gates` of one sensor only; two sensors take two namespaces.",),
)

ANY_SENSOR = SensorModel(rows=1, cols=2, num_bins=MAX_BINS, bin_width_s=1e-9, irf=[1.0], gates=GateWords())


class SketcherNode(PipelineNode):
    """Follows the latched `sensor`, also when it changes, and publishes `sketch/sensor` and a `sketch` a frame."""

    interface = INTERFACE
    _sketcher: Sketcher | None = None

    def configure(self) -> None:
        """Compile and advertise."""
        self._frequencies_for(ANY_SENSOR)       # a list that no sensor could use is refused now
        warm_up()
        self._window: deque[Sketch] = deque(maxlen=self.parameters["window_frames"])
        self._sketches = self.advertise("sketch")
        self._sketch_sensor = self.advertise("sketch/sensor")
        self.serve("reset", self._reset)

    def activate(self) -> None:
        """Follow the sensor and its photons."""
        self._sensor: SensorModel | None = None
        self._sketcher = None
        self._packets = 0
        self.hold_frames_for("a sensor description on sensor")
        self.follow("sensor", self._on_sensor)
        self.subscribe("photons", lambda raw: self._on_frame(raw, photons_message))
        self.subscribe("gates", lambda raw: self._on_frame(raw, gates_message))

    def forget(self) -> None:
        """Begin a new frame and a new window."""
        if self._sketcher is not None:
            self._sketcher.reset()
        self._packets = 0
        self._window.clear()

    def _reset(self) -> str:
        self.forget()
        return "a new frame begins"

    def _frequencies_for(self, sensor: SensorModel) -> tuple[int, ...]:
        spec, size = self.parameters["frequencies"], self.parameters["sketch_size"]
        return choose(spec, sensor, size if spec in RULES else None)

    def _on_sensor(self, message: String) -> None:
        sensor = sensor_message.decode(message)
        if sensor.same_as(self._sensor):
            return
        chosen = self._frequencies_for(sensor)
        self._sketcher = Sketcher(sensor, chosen)
        self._sensor = sensor
        self._packets = 0
        self._window.clear()
        self._sketch_sensor.publish(sketch_message.encode_sensor(sensor, chosen, self._window.maxlen))
        self.diagnostics.show(rows=sensor.rows, cols=sensor.cols, num_bins=sensor.num_bins,
                              frequencies=" ".join(map(str, chosen)))
        self.release_frames()

    def _on_frame(self, raw: bytes, codec) -> None:
        if self._sketcher is None:
            raise Dropped("no_sensor", "nobody has described the sensor on `sensor` yet")
        header, frame = codec.decode_cdr(raw, self._sensor)
        self._sketcher.add(frame)
        self._packets += 1
        if self._packets < self.parameters["packets_per_frame"]:
            return
        newest = self._sketcher.sketch()
        self._sketcher.reset()
        self._packets = 0
        self._window.append(newest)
        self._publish(reduce(add, self._window), self.parameters["frame_id"] or header.frame_id)
        self.diagnostics.count(photons=int(newest.photons.sum()))

    def _publish(self, sketch: Sketch, frame_id: str) -> None:
        data = sketch_message.encode_cdr(sketch, frame_id, self.parameters["layout"])
        self.publish_frame(self._sketches, data, sketch.stamp_ns)


def warm_up() -> None:
    """Sketch photons in every form in which they may arrive, so that nothing is compiled while frames wait."""
    sketcher = Sketcher(ANY_SENSOR, (1,))
    sketcher.add(PhotonGates(np.zeros((1, 1, 2), np.uint16)))
    for toa_dtype in TOA_DTYPES:
        for pixels in ([0, 1], [1, 0]):         # sorted and not
            sketcher.add(PhotonEvents(np.array(pixels, np.uint32), np.zeros(2, toa_dtype)))
    sketcher.sketch()


def main(args: list[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run([SketcherNode], args)


if __name__ == "__main__":
    sys.exit(main())
