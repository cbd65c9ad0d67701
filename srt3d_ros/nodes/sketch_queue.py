"""SketchQueue: sketches that wait for the description that they name."""

from typing import NamedTuple

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.messages import cdr, sensor_message, sketch_message

SENSORS_KEPT = 8        # descriptions of earlier sensors: sketches of these may still be on their way
MOST_WAITING = 16       # sketches without a description: 0.3 s at 50 Hz
WAIT_S = 2.0            # a latched description takes milliseconds, or a second while nodes discover each other


class QueuedSketch(NamedTuple):
    """A sketch message, the digest of the description that it names, and the time at which it arrived."""

    digest: str
    message: cdr.CloudMessage
    arrived_s: float


class SketchQueue:
    """Queues sketches until their description arrives on its own topic, before or after them."""

    def __init__(self):
        self._sensors: dict[str, SensorModel] = {}      # by digest, the newest last
        self._waiting: list[QueuedSketch] = []

    def __len__(self) -> int:
        """Number of sketches that wait."""
        return len(self._waiting)

    @property
    def missing(self) -> str:
        """The digest of the description that the oldest sketch waits for; empty if none waits."""
        return self._waiting[0].digest if self._waiting else ""

    def describe(self, raw: bytes) -> SensorModel:
        """Keep a serialised description and return its sensor; InvalidInput if it cannot be used."""
        text = cdr.read_text(raw)
        sensor, digest = sensor_message.from_json(text), sensor_message.digest(text)
        self._sensors.pop(digest, None)
        self._sensors[digest] = sensor
        if len(self._sensors) > SENSORS_KEPT:
            del self._sensors[next(iter(self._sensors))]
        return sensor

    def add(self, raw: bytes, now_s: float) -> None:
        """Queue a serialised sketch; InvalidInput if it names no description."""
        message = cdr.CloudMessage.read(raw)
        self._waiting.append(QueuedSketch(sketch_message.description_of(message), message, now_s))

    def take(self, now_s: float) -> tuple[list[tuple[SensorModel, QueuedSketch]], list[QueuedSketch]]:
        """Remove the sketches that need not wait any longer.

        Returns:
            Those whose description has arrived, with its sensor; and those dropped, as they have waited for WAIT_S or
            there are MOST_WAITING newer ones.
        """
        ready = [(self._sensors[one.digest], one) for one in self._waiting if one.digest in self._sensors]
        waiting = [one for one in self._waiting if one.digest not in self._sensors]
        self._waiting = [one for one in waiting[-MOST_WAITING:] if now_s - one.arrived_s < WAIT_S]
        return ready, waiting[:len(waiting) - len(self._waiting)]

    def clear(self) -> int:
        """Forget all sketches and descriptions; returns the number of sketches that waited."""
        waited = len(self._waiting)
        self._sensors.clear()
        self._waiting.clear()
        return waited
