"""Which sensor a sketcher reads photons with: that of `sensor_file`, or else of `sensor`."""

from pathlib import Path

from srt3d_ros.core.sensor.difference import first_difference
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.datasets import open_sensor
from srt3d_ros.errors import InvalidInput
from srt3d_ros.nodes.base import PipelineNode


class SensorChoice:
    """The description in force, and what contradicts the file; each change is logged once.

    A sensor_file is in force whichever node starts first, and a description on `sensor` must say the same. Without a
    file, the last description on `sensor` is in force.

    Args:
        node: with the parameter `sensor_file`.

    Raises:
        InvalidInput: the file cannot be used.

    Attributes:
        file: the sensor of the file, or None.
        sensor: that in force; None before there is one.
        contradiction: how `sensor` contradicts the file, in a line; empty if it does not.
    """

    def __init__(self, node: PipelineNode):
        path, self._log = node.parameters["sensor_file"], node.get_logger()
        self.file = open_sensor(path) if path else None
        self._file_name = Path(path).name
        self._topic = node.resolve_topic_name("sensor")
        self.forget()

    def forget(self) -> None:
        """Forget what was received."""
        self.sensor: SensorModel | None = self.file
        self.contradiction = ""

    def begin(self) -> None:
        """Log what is in force from the start."""
        if self.file is not None:
            self._log.info(f"sensor_file {self._file_name}: {in_words(self.file)}; a description on "
                           f"{self._topic} must say the same")

    def replace(self, described: SensorModel) -> bool:
        """Use a description from `sensor`, where there is no file; whether it differs from one before it."""
        before, self.sensor = self.sensor, described
        if before is None:
            self._log.info(f"sensor on {self._topic}: {in_words(described)}")
            return False
        if described.same_as(before):
            return False
        difference = first_difference(before, described)
        changed = "{} was {}, is {}".format(*difference) if difference else "numbers differ in their last digits"
        self._log.info(f"another sensor on {self._topic}: {in_words(described)}; {changed}")
        return True

    def compare(self, described: SensorModel) -> InvalidInput | None:
        """Compare a description from `sensor` with the file; the error if it contradicts the file."""
        difference = first_difference(self.file, described)
        if difference is None:
            self.agree(f"{self._topic} says the same again")
            return None
        key, ours, theirs = difference
        problem = InvalidInput(f"{key} on {self._topic}", theirs, f"{ours} as in sensor_file {self._file_name}; "
                               "photons are dropped until both say the same")
        self.contradiction = str(problem)
        return problem

    def agree(self, why: str) -> None:
        """End a contradiction."""
        if self.contradiction:
            self.contradiction = ""
            self._log.info(f"sensor_file {self._file_name} is used again: {why}")


def in_words(sensor: SensorModel) -> str:
    """Its pixels and bins."""
    return f"{sensor.rows} × {sensor.cols} pixels, {sensor.num_bins} bins of {sensor.bin_width_s * 1e12:g} ps"
