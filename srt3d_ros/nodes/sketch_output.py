"""What the sketcher publishes: `sketch`, and before the first sketch that needs it its description, `sketch/sensor`.

With `max_mbit_s`, a frame waits while its predecessor is on its way, and goes with those that come meanwhile, as one.
"""

import time
from dataclasses import dataclass

from srt3d_ros.core.framing import OpenFrame
from srt3d_ros.core.gate import in_ranges
from srt3d_ros.core.link_budget import LinkBudget
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.window import UnsentWindows, WindowSketcher
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.diagnostics import all_acknowledged
from srt3d_ros.nodes.sensor_choice import in_words

ANNOUNCE_S = 0.2            # for a description to arrive before the first sketch that needs it
RETRY_S = 0.01              # until a frame that waits is tried again: costs 1 % of a core while one does


@dataclass(eq=False)
class _Unsent:
    """Frames of one sketcher that have ended and not been sent."""

    sketcher: WindowSketcher
    design: str
    windows: UnsentWindows
    frame_id: str = ""
    frames: int = 0
    content: OpenFrame = OpenFrame()


class SketchOutput:
    """Publishes the sketches of `node`, in the layout of its parameters; called in the worker's thread."""

    def __init__(self, node: PipelineNode):
        self._node = node
        self._sketches = node.advertise("sketch")
        self._sketch_sensor = node.advertise("sketch/sensor")
        self._described: WindowSketcher | None = None       # whose sketches sketch/sensor describes
        self._unsent: _Unsent | None = None
        self._budget: LinkBudget | None = None
        self._retrying = False

    @property
    def waiting(self) -> OpenFrame:
        """Packets and photons of the frames that wait to be sent."""
        return self._unsent.content if self._unsent else OpenFrame()

    def describe(self, sketcher: WindowSketcher) -> None:
        """Publish the description of a sketcher's sketches."""
        self.flush()
        self._describe(sketcher)

    def publish(self, sketch: Sketch, frame_id: str, sketcher: WindowSketcher, design: str,
                packets: int, photons: int) -> None:
        """Publish a frame of so many packets and photons, if need be after the description of its sketcher's sketches,
        whose design is in these words, and if the link keeps up: else it waits.

        Raises:
            InvalidInput: the sketch is not one of photons.
        """
        if self._unsent and self._unsent.sketcher is not sketcher:
            self.flush()
        before, unsent = self.waiting, self._unsent or _Unsent(sketcher, design, UnsentWindows(sketcher.window_frames))
        unsent.windows.add(sketch)
        unsent.frame_id, unsent.frames = frame_id, unsent.frames + 1
        unsent.content = OpenFrame(before.packets + packets, before.photons + photons)
        self._unsent = unsent
        self._follow_parameters()
        if self._must_wait():
            self._retry_later()
            return
        try:
            self._send()
        except Exception as error:      # whoever called this counts the last frame
            if before.packets:
                self._node.failed(error, *before)
            raise

    def flush(self) -> None:
        """Publish what waits, whatever the link does."""
        if unsent := self._unsent:
            try:
                self._send()
            except Exception as error:
                self._node.failed(error, *unsent.content)

    def _send(self) -> None:
        unsent, self._unsent = self._unsent, None
        values, budget, sketch = self._node.parameters, self._budget, unsent.windows.sketch
        data = sketch_message.encode_cdr(sketch, values["frame_id"] or unsent.frame_id, values["layout"],
                                         budget.step if budget and budget.step else values["coding_step"])
        if self._described is not unsent.sketcher:
            self._announce(unsent.sketcher, unsent.design)
        self._node.publish_frame(self._sketches, data, sketch.stamp_ns, **unsent.content._asdict())
        if budget:
            before = budget.why
            budget.sent(time.monotonic(), len(data), unsent.frames)
            self._report(before)

    # ---- Frames that wait

    def _follow_parameters(self) -> None:
        values = self._node.parameters
        settings = values["max_mbit_s"], values["coding_step"] if values["layout"] == "coded" else 0.0
        if not settings[0] and self._budget:
            self._budget = None
            self._node.diagnostics.degraded = ""
        elif settings[0] and (self._budget is None or self._budget.settings != settings):
            self._budget = LinkBudget(*settings)

    def _must_wait(self) -> bool:
        return self._budget is not None and self._budget.must_wait(time.monotonic(), all_acknowledged(self._sketches))

    def _retry_later(self) -> None:
        if not self._retrying:
            self._retrying = True
            self._node.worker.call_after(RETRY_S, self._retry)

    def _retry(self) -> None:
        self._retrying = False
        if self._unsent and self._must_wait():
            self._retry_later()
        else:
            self.flush()

    def _report(self, before: str) -> None:
        """Say in /diagnostics what is in force, and in the log when it begins and ends; `before`: why it was so."""
        budget, diagnostics, log = self._budget, self._node.diagnostics, self._node.get_logger()
        now = {"coding_step_now": f"{budget.step:.3g}", "frames_per_sketch": f"{budget.frames:.2g}",
               "sketch_mbit_s": f"{budget.mbit_s:.1f}"}
        if not budget.step:
            del now["coding_step_now"]
        diagnostics.show(**now)
        words = f"degraded, {budget.why}: " + ", ".join(f"{name} {value}" for name, value in now.items())
        diagnostics.degraded = words if budget.why else ""
        if budget.why and not before:
            log.warning(words)
        elif before and not budget.why:
            log.info("no longer degraded: a sketch for each frame, at coding_step as it is set")

    # ---- Descriptions

    def _describe(self, sketcher: WindowSketcher) -> None:
        node, gate, frames = self._node, sketcher.gate, sketcher.window_frames
        sensor = sketcher.sketch_sensor
        self._sketch_sensor.publish(sketch_message.encode_sensor(sensor, sketcher.frequencies, frames))
        self._described = sketcher
        node.diagnostics.show(rows=sensor.rows, cols=sensor.cols, num_bins=sensor.num_bins, window_frames=frames,
                              frequencies=" ".join(map(str, sketcher.frequencies)), gate=in_ranges(gate))
        node.release_frames()

    def _announce(self, sketcher: WindowSketcher, design: str) -> None:
        """Describe the sketches that begin now: after the last of the old ones has been read, if readers keep up."""
        self._describe(sketcher)
        sensor = sketcher.sketch_sensor
        self._node.get_logger().info(f"sketches of {in_words(sensor)}: {design}")
        self._node.wait_until(lambda: all_acknowledged(self._sketch_sensor), "sketch/sensor to arrive", ANNOUNCE_S)
