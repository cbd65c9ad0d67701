"""Which sensor a sketcher reads photons with: that of `sensor_file` or else of `sensor`, with a CameraInfo's lens."""

from collections.abc import Callable
from pathlib import Path

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo

from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sensor_difference import first_difference
from srt3d_ros.datasets import open_sensor
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages.camera import decode_camera_info
from srt3d_ros.nodes.base import PipelineNode


class SensorChoice:
    """The description in force, the lens, and what contradicts the file; each change is logged once.

    A sensor_file is in force whichever node starts first, and a description on `sensor` must say the same. Without a
    file, the last description on `sensor` is in force. A lens that fits the pixels replaces the projection of either.

    Args:
        node: with the parameter `sensor_file`.
        refuse_lens: called with the reason why a lens is not used.

    Raises:
        InvalidInput: the file cannot be used.

    Attributes:
        file: the sensor of the file, or None.
        lens: rows, columns and pinhole of a CameraInfo, or None.
        contradiction: how `sensor` contradicts the file, in a line; empty if it does not.
    """

    def __init__(self, node: PipelineNode, refuse_lens: Callable[[str], None]):
        path, self._log, self._refuse_lens = node.parameters["sensor_file"], node.get_logger(), refuse_lens
        self.file = open_sensor(path) if path else None
        self._file_name = Path(path).name
        self._sensor_topic, self._lens_topic = map(node.resolve_topic_name, ("sensor", "sensor/camera_info"))
        self.forget()

    def forget(self) -> None:
        """Forget what was received."""
        self._described: SensorModel | None = self.file
        self.lens: tuple[int, int, Pinhole] | None = None
        self._projection: Pinhole | None = None     # of the lens, while it is in force
        self.contradiction = ""

    def begin(self) -> None:
        """Log what is in force from the start."""
        if self.file is not None:
            self._log.info(f"sensor_file {self._file_name}: {in_words(self.file)}; a description on "
                           f"{self._sensor_topic} must say the same")

    def replace(self, described: SensorModel) -> bool:
        """Use a description from `sensor`, where there is no file; whether it differs from one before it."""
        before, self._described = self._described, described
        if before is None:
            self._log.info(f"sensor on {self._sensor_topic}: {in_words(described)}")
            return False
        if described.same_as(before):
            return False
        difference = first_difference(before, described)
        changed = "{} was {}, is {}".format(*difference) if difference else "numbers differ in their last digits"
        self._log.info(f"another sensor on {self._sensor_topic}: {in_words(described)}; {changed}")
        return True

    def compare(self, described: SensorModel) -> InvalidInput | None:
        """Compare a description from `sensor` with the file; the error if it contradicts the file."""
        difference = first_difference(self.file, described)
        if difference is None:
            self.agree(f"{self._sensor_topic} says the same again")
            return None
        key, ours, theirs = difference
        problem = InvalidInput(f"{key} on {self._sensor_topic}", theirs, f"{ours} as in sensor_file {self._file_name}; "
                               "photons are dropped until both say the same")
        self.contradiction = str(problem)
        return problem

    def agree(self, why: str) -> None:
        """End a contradiction."""
        if self.contradiction:
            self.contradiction = ""
            self._log.info(f"sensor_file {self._file_name} is used again: {why}")

    def sensor(self) -> SensorModel | None:
        """The description with the lens; None before there is a description."""
        described, before, self._projection = self._described, self._projection, None
        if described is None or self.lens is None:
            return described
        rows, cols, pinhole = self.lens
        if (rows, cols) != (described.rows, described.cols):
            self._refuse_lens(f"its pixels are {rows} × {cols}: expected {described.rows} × {described.cols}")
            return described
        self._projection = pinhole
        if pinhole != before:
            self._log.info(f"{self._lens_topic} replaces the projection: fx {pinhole.fx:g}, fy {pinhole.fy:g}, "
                           f"cx {pinhole.cx:g}, cy {pinhole.cy:g} pixels")
        return described.replace(projection=pinhole)


def read_lens(raw: bytes) -> tuple[int, int, Pinhole]:
    """Rows, columns and lens of a serialised CameraInfo; InvalidInput if there is none in it."""
    try:
        message = deserialize_message(raw, CameraInfo)
    except rclpy_implementation.RMWError:
        raise InvalidInput("message", f"{len(raw)} bytes", "a serialised CameraInfo") from None
    return decode_camera_info(message)


def in_words(sensor: SensorModel) -> str:
    """Its pixels and bins."""
    return f"{sensor.rows} × {sensor.cols} pixels, {sensor.num_bins} bins of {sensor.bin_width_s * 1e12:g} ps"
