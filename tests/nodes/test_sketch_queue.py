"""SketchQueue: which sketches are ready, which wait, and which have waited too long."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sums import noise_sketch
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import sensor_message, sketch_message
from srt3d_ros.nodes.sketch_queue import MOST_WAITING, SENSORS_KEPT, WAIT_S, SketchQueue

SENSORS = [SensorModel(2, 3, 50 + k, 1e-10, np.ones(3)) for k in range(SENSORS_KEPT + 1)]
DESCRIPTIONS = [sensor_message.encode_cdr(sensor) for sensor in SENSORS]
DIGESTS = [sensor_message.digest(sensor) for sensor in SENSORS]


def sketch(k: int) -> bytes:
    """A sketch of sensor k."""
    return sketch_message.encode_cdr(noise_sketch(SENSORS[k], (1, 2)), "lidar")


@pytest.fixture
def sketches() -> SketchQueue:
    return SketchQueue()


def taken(sketches: SketchQueue, now_s: float = 0.0) -> tuple[list[int], list[int]]:
    """The sensors' numbers of the sketches that were ready, and of those that were dropped."""
    ready, dropped = sketches.take(now_s)
    for sensor, queued in ready:
        assert sketch_message.decode(queued.message, sensor).sensor is sensor
    return [sensor.num_bins - 50 for sensor, _ in ready], [DIGESTS.index(queued.digest) for queued in dropped]


def test_descriptions_and_sketches_come_in_any_order_and_the_last_descriptions_are_kept(sketches):
    for k in (0, 1, 0):
        sketches.add(sketch(k), 0.0)
    assert taken(sketches) == ([], []) and (len(sketches), sketches.missing) == (3, DIGESTS[0])
    assert sketches.describe(DESCRIPTIONS[1]).same_as(SENSORS[1])
    sketches.add(sketch(1), 0.1)
    assert taken(sketches, 0.1) == ([1, 1], []) and len(sketches) == 2
    sketches.describe(DESCRIPTIONS[0])
    assert taken(sketches, 0.2) == ([0, 0], []) and (len(sketches), sketches.missing) == (0, "")
    sketches.add(sketch(1), 0.3)
    assert taken(sketches, 0.3) == ([1], [])
    for raw in [*DESCRIPTIONS[:2], DESCRIPTIONS[0], *DESCRIPTIONS[2:]]:
        sketches.describe(raw)
    for k in (0, 1, 2):
        sketches.add(sketch(k), 0.0)
    assert taken(sketches)[0] == [0, 2] and sketches.missing == DIGESTS[1]


def test_only_some_sketches_wait_and_for_a_while(sketches):
    for k in range(MOST_WAITING + 2):
        sketches.add(sketch(k % 2), k * 0.01)
    assert taken(sketches, 0.2) == ([], [0, 1]) and len(sketches) == MOST_WAITING
    assert taken(sketches, WAIT_S + 0.025) == ([], [0])
    assert sketches.clear() == MOST_WAITING - 1 and len(sketches) == 0


def test_what_cannot_be_used_is_refused_and_changes_nothing(sketches):
    with pytest.raises(InvalidInput, match="^unknown key is"):
        sketches.describe(DESCRIPTIONS[0].replace(b'"rows"', b'"raws"'))
    with pytest.raises(InvalidInput, match="^field sensor_DIGEST is absent"):
        sketches.add(sketch(0).replace(b"sensor_", b"sensors"), 0.0)
    assert len(sketches) == 0
