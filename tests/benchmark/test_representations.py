"""Each representation: its bytes are those that zstd packs, and clouds of a wall that is hardly noisy are right."""

import numpy as np
import pytest

from srt3d_ros import zstd
from srt3d_ros.benchmark import representations
from srt3d_ros.benchmark.representations import PIXEL, POOLED, REPRESENTATIONS, Frame
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.messages import coded_sketch

DEPTH, ROWS, COLS = 77.0, 12, 14


@pytest.fixture(scope="module", params=["bin_center", "bin_edge"])
def wall(request):
    """60 photons a pixel from a wall at DEPTH, 3 of the background."""
    sensor = SensorModel(ROWS, COLS, 200, 1e-10, np.hanning(9)[1:-1], toa_reference=request.param)
    random = np.random.default_rng(1)
    pixel = np.repeat(np.arange(sensor.pixels, dtype=np.uint32), 63)
    offset = random.choice(len(sensor.irf), len(pixel), p=sensor.irf / sensor.irf.sum()) - sensor.irf_ref
    toa = np.where(np.arange(len(pixel)) % 63 < 60, DEPTH + offset, random.integers(0, 200, len(pixel)))
    return Frame(PhotonEvents(pixel, toa.astype(np.uint16)), sensor)


@pytest.mark.parametrize("name", REPRESENTATIONS)
def test_the_largest_size_shows_the_wall_where_it_is(wall, name):
    packed = list(REPRESENTATIONS[name](wall, 1))
    for how, reconstruct in [cloud for one in packed[-8:] for cloud in one.clouds][-3:]:
        cloud = reconstruct()
        error = np.abs(cloud.depth_bins - DEPTH - wall.sensor.first_bin_center)
        assert len(cloud) == ROWS * COLS and np.median(error) < (0.15 if how == POOLED else 1), (name, how)


def test_sizes_are_those_of_what_zstd_packs_and_unpacks(wall, monkeypatch):
    packed = []
    compress = zstd.compress
    monkeypatch.setattr(zstd, "compress", lambda data, level: packed.append(compress(data, level=level)) or packed[-1])
    codes = np.random.default_rng(0).integers(-300, 300, (5, 168))
    assert representations.packed_size(codes) == len(packed[-1])
    numbers = np.frombuffer(zstd.decompress(packed[-1]), np.uint8).reshape(2, -1).T.copy().view(np.uint16).ravel()
    signed = (numbers >> 1).astype(int) ^ -(numbers & 1).astype(int)
    assert np.array_equal(signed.reshape(5, -1), codes) or np.array_equal(signed.reshape(168, 5).T, codes)
    ours = next(REPRESENTATIONS[representations.OURS](wall, 1))
    assert coded_sketch.decode_counts(_encoded(wall)).sum() == 63 * ROWS * COLS
    assert ours.bytes == len(_encoded(wall)) and ours.clouds[-1][0] in (POOLED, PIXEL)


def _encoded(frame: Frame) -> bytes:
    sketch = representations.sketch_photons(frame.photons, frame.sensor, frame.frequencies(3))
    return coded_sketch.encode(sketch, coded_sketch.DEFAULT_STEP)


def test_photons_are_thinned_to_the_bytes_that_were_asked_for(wall):
    *thinned, every = REPRESENTATIONS["photons"](wall, 1)
    assert every.size == "100 %" and len(thinned) >= 3
    for one, target in zip(thinned, representations.KEPT):
        assert 0.9 * target < one.bytes / wall.sensor.pixels <= target
