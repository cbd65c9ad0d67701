"""The bytes of the layout `coded` of `sketch` (msg_schemas/sketch.json); core.sketching.coding rounds, zstd packs."""

import struct

import numpy as np

from srt3d_ros import zstd
from srt3d_ros.core.sensor.model import MAX_PIXELS
from srt3d_ros.core.sketching.coding import LONGEST, MAX_DIGITS, RoundedSums, restored, rounded
from srt3d_ros.core.sketching.sketch import Sketch
from srt3d_ros.errors import InvalidInput, require

STEP = 0.4                      # σ: what rounding adds to the variance of photon noise, STEP² / 12, is 1.3 %
MIN_STEP, MAX_STEP = 0.1, 2.0   # of other encoders
HEADER = struct.Struct("<IIHBBf")       # rows, cols, m, bytes of a count, digits of a number, step
# Noise does not repeat: entropy coding is what counts. Repetitions are looked for if they are long, with a small table.
# A reader needs 2¹⁷ bytes for the window.
PACKING = {zstd.CompressionParameter.compression_level: 1, zstd.CompressionParameter.min_match: 7,
           zstd.CompressionParameter.hash_log: 8, zstd.CompressionParameter.window_log: 17,
           zstd.CompressionParameter.checksum_flag: 1}
UNPACKING = {zstd.DecompressionParameter.window_log_max: 17}


def encode(sketch: Sketch) -> bytes:
    """The bytes of a sketch, its sums rounded to multiples of STEP · √(n/2).

    Raises:
        InvalidInput: sums that so many photons cannot have.
    """
    coded, counts = rounded(sketch, STEP), np.ascontiguousarray(sketch.photons, "<u4").reshape(-1)
    digits, m, _ = coded.digits.shape
    count_bytes = -(-int(counts.max(initial=0)).bit_length() // 8)
    packer = zstd.ZstdCompressor(options=PACKING)
    packed = [packer.compress(section, packer.FLUSH_BLOCK) for section in (     # each by its own statistics
        *_byte_planes(counts)[:count_bytes], *_byte_planes(coded.positions), *coded.digits.reshape(digits * m, -1))]
    head = HEADER.pack(*sketch.photons.shape, m, count_bytes, digits, STEP)
    return b"".join((head, coded.gains.astype("<c8").tobytes(), *packed, packer.flush()))


def decode(raw: bytes, frequencies: tuple[int, ...], shape: tuple[int, int] | None = None) -> tuple[np.ndarray, ...]:
    """Photons, uint32 [rows, cols], sums, complex64 [rows, cols, m], and the variance that rounding added, over n/2.

    Args:
        raw: from `encode`, or from anybody.
        frequencies: the k_l.
        shape: rows and cols that it must have.

    Raises:
        InvalidInput: it breaks off, contradicts frequencies or shape, or has sums that so many photons cannot have.
    """
    rows, cols, m, count_bytes, digits, step = _read_header(raw, shape)
    require(m == len(frequencies), "coded m", m, f"{len(frequencies)}, as many as there are frequencies")
    pixels, at = rows * cols, HEADER.size + 8 * m
    require(len(raw) >= at, "coded gains", f"cut off at byte {len(raw)}", f"{8 * m} bytes")
    gains = np.frombuffer(raw[HEADER.size:at], "<c8")
    largest = float(np.abs(gains).max())
    require(largest <= LONGEST, "coded gains", f"up to {largest:g}", "numbers of modulus 1 or less")
    sizes = [count_bytes * pixels, 2 * pixels, digits * m * pixels]
    data = np.frombuffer(_unpacked(raw[at:], sum(sizes), whole=True), np.uint8)
    counts, positions, planes = np.split(data, np.cumsum(sizes)[:2])
    counts = _from_byte_planes(counts, pixels)
    coded = RoundedSums(gains, _from_byte_planes(positions, pixels), planes.reshape(digits, m, pixels))
    sums = restored(coded, counts, frequencies, step)
    return counts.reshape(rows, cols), sums.reshape(rows, cols, m), step**2 / 12


def decode_counts(raw: bytes) -> np.ndarray:
    """Photons, uint32 [rows, cols], without the sums; InvalidInput as for `decode`."""
    rows, cols, m, count_bytes, *_ = _read_header(raw)
    counts = _unpacked(raw[HEADER.size + 8 * m:], count_bytes * rows * cols)
    return _from_byte_planes(np.frombuffer(counts, np.uint8), rows * cols).reshape(rows, cols)


def _read_header(raw: bytes, shape: tuple[int, int] | None = None) -> tuple:
    require(len(raw) >= HEADER.size, "coded", f"{len(raw)} bytes", f"{HEADER.size} bytes or more")
    rows, cols, m, count_bytes, digits, step = HEADER.unpack_from(raw)
    for name, count, wanted in (("rows", rows, shape and shape[0]), ("cols", cols, shape and shape[1])):
        require(0 < count <= MAX_PIXELS, f"coded {name}", count, "1 or more")
        require(wanted in (None, count), f"coded {name}", count, f"the sensor's {wanted}")
    require(rows * cols <= MAX_PIXELS, "coded rows × cols", rows * cols, f"at most {MAX_PIXELS}")
    require(count_bytes <= 4, "coded count_bytes", count_bytes, "0 to 4")
    require(1 <= digits <= MAX_DIGITS, "coded digits", digits, f"1 to {MAX_DIGITS}")
    require(MIN_STEP <= step <= MAX_STEP, "coded step", step, f"{MIN_STEP:g} to {MAX_STEP:g}")
    return rows, cols, m, count_bytes, digits, step


def _unpacked(packed: bytes, size: int, whole: bool = False) -> bytes:
    """The first `size` bytes of what zstd packed, or all of it; more are not unpacked."""
    unpacker = zstd.ZstdDecompressor(options=UNPACKING)
    try:
        data = unpacker.decompress(packed, max_length=size + whole)
    except zstd.ZstdError as error:
        raise InvalidInput("coded data", f"unreadable ({error})", "what zstd packs, in a window of 2¹⁷ bytes") from None
    complete = len(data) == size and (not whole or unpacker.eof and not unpacker.unused_data)
    require(complete, "coded data", f"{len(packed)} bytes of zstd, cut off or of another size",
            f"{size} bytes packed, and nothing after them")
    return data


def _byte_planes(values: np.ndarray) -> np.ndarray:
    """uint8 [bytes of a value, values], the low bytes first."""
    return np.ascontiguousarray(values.view(np.uint8).reshape(len(values), -1).T)


def _from_byte_planes(planes: np.ndarray, count: int) -> np.ndarray:
    """uint32 [count]."""
    values = np.zeros((count, 4), np.uint8)
    values[:, :len(planes) // count] = planes.reshape(-1, count).T
    return values.view("<u4")[:, 0]
