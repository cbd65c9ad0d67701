"""The layout `coded` of `sketch`: what rounding costs, bytes of a surface, the byte table, and hostile bytes."""

import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from srt3d_ros import zstd
from srt3d_ros.core.sensor.model import MAX_PIXELS
from srt3d_ros.core.sketching.sketch import Sketch
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import coded_sketch as coded

FREQUENCIES = (1, 3, 7, 12)
BINS = 100
GAINS_END = coded.HEADER.size + 8 * len(FREQUENCIES)


def scene(seed: int = 0, rows: int = 13, cols: int = 18, mean: float = 10.0, signal: float = 1.0) -> Sketch:
    """A slanted surface, whose photons spread by 2 bins, and background; its photons are Poisson."""
    rng = np.random.default_rng(seed)
    photons = rng.poisson(mean, (rows, cols)).astype(np.uint32)
    depth = 40 + np.arange(rows)[:, None] + 0.5 * np.arange(cols)
    pixel = np.repeat(np.arange(rows * cols), photons.reshape(-1))
    toa = np.where(rng.random(len(pixel)) < signal, rng.normal(depth.reshape(-1)[pixel], 2.0),
                   rng.uniform(0, BINS, len(pixel)))
    sums = np.zeros((rows * cols, len(FREQUENCIES)), complex)
    np.add.at(sums, pixel, np.exp(2j * np.pi * np.outer(toa, FREQUENCIES) / BINS))
    return Sketch(FREQUENCIES, sums.reshape(rows, cols, -1).astype(np.complex64), photons)


def parts_of(sketch: Sketch, raw: bytes) -> np.ndarray:
    """Error of each part of the sums in standard deviations of their photon noise, [pixels with photons, 2m]."""
    photons, sums, _ = coded.decode(raw, FREQUENCIES, sketch.photons.shape)
    assert (photons == sketch.photons).all() and (coded.decode_counts(raw) == photons).all()
    seen = photons > 0
    return (sums - sketch.sums)[seen].view(np.float32) / np.sqrt(photons[seen] / 2)[:, None]


@pytest.mark.parametrize("step", [coded.MIN_STEP, 0.4, coded.MAX_STEP])
@pytest.mark.parametrize("mean", [0.7, 10, 5e3, 1e9])
def test_rounding_adds_no_more_than_the_variance_that_the_decoder_gives(monkeypatch, step, mean):
    monkeypatch.setattr(coded, "STEP", step)
    sketch = scene(mean=0) if mean == 1e9 else scene(mean=mean)
    if mean == 1e9:
        rng = np.random.default_rng(1)
        sketch.photons[:] = rng.integers(0, 2**32, sketch.photons.shape)
        sketch.sums[:] = sketch.photons[..., None] * np.exp(1j * rng.uniform(0, 7, sketch.sums.shape)) * 0.9
    raw = coded.encode(sketch)
    error = parts_of(sketch, raw)
    allowed = coded.decode(raw, FREQUENCIES)[2]
    float32 = 1e-6 * float(np.sqrt(sketch.photons.max()))      # rounding of the sums themselves
    assert allowed == pytest.approx(step**2 / 12)
    assert np.square(error).mean() <= 1.1 * allowed + float32**2
    assert np.abs(error).max() <= step / 2**0.5 + float32


def test_bytes_of_a_surface_are_fewer_than_those_of_noise():
    sizes = {signal: len(coded.encode(scene(rows=64, cols=64, signal=signal))) / 64**2 for signal in (0.0, 1.0)}
    noise_bits = 2 * len(FREQUENCIES) * np.log2(np.sqrt(2 * np.pi * np.e) / 0.4) + 4
    assert sizes[0.0] * 8 < 1.1 * noise_bits
    assert sizes[1.0] < 0.85 * sizes[0.0]
    assert sizes[1.0] < (4 + 8 * len(FREQUENCIES)) / 7       # float32


def decode_by_the_table(raw: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Photons and sums, as msg_schemas/sketch.json says, number by number."""
    rows, cols, m, count_bytes, digits, step = struct.unpack_from("<IIHBBf", raw)
    gains = [complex(*struct.unpack_from("<ff", raw, 16 + 8 * l)) for l in range(m)]
    data, pixels = zstd.decompress(raw[16 + 8 * m:]), rows * cols
    positions = 1
    while positions < 16 * max(FREQUENCIES):
        positions *= 2
    at = count_bytes * pixels
    last, photons, sums = 0, [], []
    for p in range(pixels):
        n = sum(data[k * pixels + p] << 8 * k for k in range(count_bytes))
        word = data[at + p] | data[at + pixels + p] << 8
        last += (word - 1) // 2 if word % 2 else -(word // 2)
        photons.append(n)
        for l, frequency in enumerate(FREQUENCIES):
            pairs = [data[at + (2 + k * m + l) * pixels + p] for k in range(digits)]
            re, im = (sum((pair >> shift) % 16 * 16**k - 8 * 16**k for k, pair in enumerate(pairs)) for shift in (0, 4))
            value = complex(re, im) * step * np.sqrt(max(n, 1) / 2)
            if word:
                value += (1 + (n - 1) * gains[l]) * np.exp(2j * np.pi * frequency * last / positions)
            sums.append(value / max(abs(value) / n, 1) if n else 0)
    return np.reshape(photons, (rows, cols)), np.reshape(sums, (rows, cols, m))


def test_golden_bytes_say_what_the_byte_table_says():
    raw = bytes.fromhex((Path(__file__).parent / "golden" / "coded_scene.hex").read_text())
    photons, sums, _ = coded.decode(raw, FREQUENCIES, (5, 6))
    expected = decode_by_the_table(raw)
    assert raw[10] == 2 and raw[11] == 2        # counts above 255, numbers above 7
    assert (photons == expected[0]).all() and np.allclose(sums, expected[1], rtol=1e-5, atol=1e-4)
    original = scene(seed=3, rows=5, cols=6, mean=300, signal=0.8)
    assert (photons == original.photons).all()
    assert (np.abs(sums - original.sums) <= 0.1 / 2 * np.sqrt(photons)[..., None] + 1e-4).all()


# ---- Malformed and hostile

def repacked(change) -> bytes:
    """Bytes of a scene with its unpacked data changed by `change(data, pixels)`."""
    raw = coded.encode(scene())
    data = bytearray(zstd.decompress(raw[GAINS_END:]))
    return raw[:GAINS_END] + zstd.compress(bytes(change(data, 13 * 18) or data), options=coded.PACKING)


def put(at: int, form: str, *values):
    """The bytes of a scene with other ones in their header."""
    raw = bytearray(coded.encode(scene()))
    struct.pack_into(form, raw, at, *values)
    return bytes(raw)


def dark_but_not_zero(data: bytearray, pixels: int) -> None:
    data[:pixels] = bytes(pixels)


MALFORMED = {
    "half a header": (lambda: coded.encode(scene())[:9], "coded"),
    "gains cut": (lambda: coded.encode(scene())[:30], "coded gains"),
    "no rows": (lambda: put(0, "<I", 0), "coded rows"), "other rows": (lambda: put(0, "<I", 18), "coded rows"),
    "2³² cols": (lambda: put(4, "<I", 2**32 - 1), "coded cols"), "other m": (lambda: put(8, "<H", 5), "coded m"),
    "counts of 5 bytes": (lambda: put(10, "<B", 5), "coded count_bytes"),
    "7 digits": (lambda: put(11, "<B", 7), "coded digits"),
    "step NaN": (lambda: put(12, "<f", np.nan), "coded step"),
    "gain NaN": (lambda: put(16, "<f", np.nan), "coded gains"),
    "not zstd": (lambda: coded.encode(scene())[:GAINS_END] + b"zstd?", "coded data"),
    "zstd cut": (lambda: coded.encode(scene())[:-1], "coded data"),
    "more after zstd": (lambda: coded.encode(scene()) + b"a", "coded data"),
    "too much data": (lambda: repacked(lambda data, pixels: data + b"a"), "coded data"),
    "window of 8 MB": (lambda: coded.encode(scene())[:GAINS_END] + zstd.compress(
        bytes(2**24), options={zstd.CompressionParameter.window_log: 23}), "coded data"),
    "sums without photons": (lambda: repacked(dark_but_not_zero), "sketch"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_bytes_give_one_line_that_names_the_field(case):
    make, field = MALFORMED[case]
    with pytest.raises(InvalidInput) as caught:
        coded.decode(make(), FREQUENCIES, (13, 18))
    assert caught.value.field == field and len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("count_only", [False, True])
def test_a_bomb_unpacks_to_no_more_than_the_sensor_has(count_only):
    bomb = coded.encode(scene())[:GAINS_END] + zstd.compress(bytes(2**27), options=coded.PACKING)
    tracemalloc.start()
    if count_only:
        assert (coded.decode_counts(bomb) == 0).all()
    else:
        with pytest.raises(InvalidInput, match="^coded data is "):
            coded.decode(bomb, FREQUENCIES, (13, 18))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2**20


def test_counts_of_more_pixels_than_a_sensor_may_have_are_refused_unread():
    with pytest.raises(InvalidInput, match="^coded rows × cols is "):
        coded.decode_counts(put(0, "<II", MAX_PIXELS // 2, 3))


def test_sums_that_photons_cannot_have_are_not_written():
    sketch = scene()
    for factor in (1.01, np.nan):
        sums = sketch.sums.copy()
        sums[2, 3] = factor * sketch.photons[2, 3]
        with pytest.raises(InvalidInput, match="^sketch is up to "):
            coded.encode(Sketch(FREQUENCIES, sums, sketch.photons))
