"""DescribedSketches: serialised sketches, each with the sensor of the description that it names, once that has come."""

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.messages import sensor_message, sketch_message

SENSORS_KEPT = 8        # for sketches that are still on their way when the description changes
MOST_WAITING = 16       # sketches whose description has not come: 0.3 s at 50 Hz
WAIT_S = 2.0            # a latched description takes milliseconds, and a second where nodes are being discovered


class DescribedSketches:
    """Pairs sketches and descriptions, which come on two topics, in whatever order they arrive."""

    def __init__(self):
        self._sensors: dict[str, SensorModel] = {}              # by digest, the newest last
        self._waiting: list[tuple[str, bytes, float]] = []      # what a sketch names, the sketch, when it came

    def __len__(self) -> int:
        """Sketches whose description has not come."""
        return len(self._waiting)

    @property
    def missing(self) -> str:
        """The digest of a description that sketches wait for; empty if none do."""
        return self._waiting[0][0] if self._waiting else ""

    def describe(self, text: str) -> SensorModel:
        """Keep a description and return its sensor; InvalidInput if it cannot be used."""
        sensor, digest = sensor_message.from_json(text), sensor_message.digest(text)
        self._sensors.pop(digest, None)
        self._sensors[digest] = sensor
        if len(self._sensors) > SENSORS_KEPT:
            del self._sensors[next(iter(self._sensors))]
        return sensor

    def add(self, raw: bytes, now_s: float) -> None:
        """Keep a sketch until `take`; InvalidInput if it names no description."""
        self._waiting.append((sketch_message.description_cdr(raw), raw, now_s))

    def take(self, now_s: float) -> tuple[list[tuple[str, SensorModel, bytes]], list[str]]:
        """Remove the sketches that need not or must not wait any longer.

        Returns:
            Those whose description has come: its digest and sensor, and the sketch; and what the others named, that
            have waited for WAIT_S or were pushed out by MOST_WAITING newer ones.
        """
        ready = [(named, self._sensors[named], raw) for named, raw, _ in self._waiting if named in self._sensors]
        waiting = [one for one in self._waiting if one[0] not in self._sensors]
        self._waiting = [one for one in waiting[-MOST_WAITING:] if now_s - one[2] < WAIT_S]
        return ready, [named for named, *_ in waiting[:len(waiting) - len(self._waiting)]]

    def clear(self) -> int:
        """Forget all; how many sketches waited."""
        waited = len(self._waiting)
        self._sensors.clear()
        self._waiting.clear()
        return waited
