"""The sketch file: what is written is read, and what cannot be used is one line that names file and array."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sensor.projection import AngularScan
from srt3d_ros.core.sketching.sketch import Sketch
from srt3d_ros.datasets import sketch_file
from srt3d_ros.errors import InvalidInput

SENSOR = SensorModel(2, 3, 50, 1e-10, np.eye(6, 9) + 0.2, gain=np.full((2, 3), 0.5), mask=np.eye(2, 3) == 0,
                     projection=AngularScan(0.1, 0.2, 0.3, 0.4), gates=GateWords(5), toa_offset_bins=1 / 3)
PHOTONS = np.array([[3, 0, 2], [1, 1, 4_000_000_000]], np.uint32)
SKETCH = Sketch((1, 4), (PHOTONS[..., None] * np.exp([0.1j, 0.7j])).astype(np.complex64), PHOTONS, 1_700_000_000_000,
                added_variance=0.013)


@pytest.fixture
def path(tmp_path):
    sketch_file.save(tmp_path / "sketch.npz", SKETCH, SENSOR, ("one: ½", "two"))
    return tmp_path / "sketch.npz"


def test_what_is_written_is_read_to_the_bit(path):
    sketch, sensor, notes = sketch_file.read(path)
    assert sensor.same_as(SENSOR) and notes == ("one: ½", "two")
    assert (sketch.frequencies, sketch.stamp_ns, sketch.added_variance) == ((1, 4), SKETCH.stamp_ns, 0.013)
    for name in ("sums", "photons"):
        assert np.array_equal(getattr(sketch, name), getattr(SKETCH, name))
        assert getattr(sketch, name).dtype == getattr(SKETCH, name).dtype


@pytest.mark.parametrize(("changes", "said"), [
    ({"added_variance": np.float64("nan")}, "added_variance is nan: expected 0 or more"),
    ({"sums": None}, "sums is missing: expected the arrays frequencies, sums, "),
    ({"sums": np.zeros((2, 3, 2))}, r"sums is float64 \(2, 3, 2\): expected what Sketch.save writes"),
    ({"sums": np.full((2, 3, 2), np.nan + 0j)}, "sums is not finite in places"),
    ({"sums": np.zeros((2, 3, 3), complex)}, "sketch shape is "), ({"photons": PHOTONS.T}, "photons shape is "),
    ({"photons": PHOTONS[:1], "sums": SKETCH.sums[:1]}, r"sketch size is \(1, 3\): expected \(2, 3\), the sensor's"),
    ({"frequencies": np.array([1, 25])}, "frequencies is 25: expected integers from 1 to 24"),
    ({"sensor": np.array([0xFF], np.uint8)}, "sensor is broken text"),
    ({"notes": np.array([0x7FFFFFFF], np.uint32).view("<U1")}, "notes is not text in places"),
    ({"sensor": np.frombuffer(b'{"schema_version":1}', np.uint8)}, "(rows|.*unknown|schema_version)")])
def test_what_cannot_be_used_names_file_and_array(path, changes, said):
    with np.load(path) as file:
        arrays = dict(file) | changes
    np.savez(path, **{name: values for name, values in arrays.items() if values is not None})
    with pytest.raises(InvalidInput, match=f"^sketch.npz {said}"):
        sketch_file.read(path)


def test_a_file_that_cannot_be_written_is_refused_and_leaves_nothing(tmp_path, full_disk):
    for path, sensor, said in (("a.mat", SENSOR, "sketch file is a.mat: expected a name that ends in .npz"),
                               ("a.npz", SENSOR, "sketch file is .*a.npz: expected a file that can be written .File"),
                               ("a.npz", SensorModel(3, 2, 50, 1e-10, [1]), "sketch size is ")):
        with pytest.raises(InvalidInput, match=f"^{said}"):
            sketch_file.save(tmp_path / path, SKETCH, sensor)
    assert list(tmp_path.iterdir()) == []
