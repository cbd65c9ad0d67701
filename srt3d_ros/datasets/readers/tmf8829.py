"""ams TMF8829: the messages of the ZeroMQ publisher in ams' Python driver (port 5558), and its JSON logs.

    https://github.com/ams-OSRAM/tmf8829_driver_python: tmf8829/zeromq/TMF8829_zeromq_protocol.md, tmf8829/utilities

A message is a container header of 84 bytes and frames: 5 bytes from the host, a header of 16, data, a footer of 12. The
histogram frames of a measurement hold four reference histograms each, and those of half the zones (16 × 16), or an
eighth or a twelfth. Bins have 24 bits. The device's T bins end in one that is measured in part, which is left out.

Verified on a log of 26 frames of 16 × 16 zones: bin width, time zero, rays, the device's clock. From the driver's
source only, for want of a device: messages (tests build them), 8 × 8, 32 × 32 and 48 × 32 zones, the reference pulse
where bins are narrower than its own (8 × 8), dual mode, of which the frames that come last are used.
"""

import struct
from collections.abc import Iterator

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.core.sketching.photons import PhotonHistograms
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.datasets.values import whole_counts
from srt3d_ros.errors import InvalidInput, require

NAME = "tmf8829"
NOTE = "ranges count from the reference pulse"
MAGIC, CONTAINER, BEFORE, HEADER, FOOTER, REFERENCE = 0xFE5E1234, 84, 5, 16, 12, 60   # bytes
RESULTS, HISTOGRAMS, REFERENCE_SPADS = 0x10, 0x20, 0x30
CONVERTER_S = 200e-12       # of its time-to-digital converter; histograms sum 2^bin_shift of these
MEASURED = 218              # of these, unless the configuration says otherwise; messages do not tell it
REFERENCE_BINS = 64
SIZES = {0: (8, 8), 1: (8, 8), 2: (16, 16), 3: (32, 32), 4: (32, 32), 5: (32, 48)}      # rows, columns by mode
TICK_NS = 1000              # 26 frames of 33 ms are so far apart


def frames(log: dict, name: str) -> Iterator[Photons]:
    """The frames of a log, stamped by the device's clock; InvalidInput where one is broken."""
    require(isinstance(log["Result_Set"], list) and log["Result_Set"], f"{name} Result_Set", "no list or empty",
            "a list of frames: log with combined_results and histograms")
    configuration = log.get("configuration")
    for k, frame in enumerate(log["Result_Set"]):
        try:
            yield _of_log(frame, configuration if isinstance(configuration, dict) else {}, f"{name} frame {k}")
        except InvalidInput:
            raise
        except (LookupError, TypeError, AttributeError, ArithmeticError, ValueError) as error:
            raise InvalidInput(f"{name} frame {k}", f"without {error}", "mp_histo and ref_histo") from None


def _of_log(frame: dict, configuration: dict, name: str) -> Photons:
    zones = whole_counts(f"{name} mp_histo", [[zone["bin"] for zone in row] for row in frame["mp_histo"]], (-1, -1, -1))
    references = whole_counts(f"{name} ref_histo", [one["bin"] for one in frame["ref_histo"]], (-1, REFERENCE_BINS))
    require(zones.shape[:2] in SIZES.values(), f"{name} mp_histo", zones.shape[:2], "8 × 8 to 32 × 48 zones")
    mode = next(mode for mode, size in SIZES.items() if size == zones.shape[:2])
    require(len(references) == 4 * _parts(mode), f"{name} ref_histo", len(references), f"{4 * _parts(mode)} histograms")
    info = frame.get("info", {})
    stamp_ns = min(int(info.get("systick_t0", 0)), int(info.get("systick_t1", 0))) * TICK_NS
    steps, shift = int(configuration.get("histogram_bins", MEASURED)), configuration.get("bin_shift", _shift(mode))
    require(shift in range(3), f"{name} bin_shift", shift, "0, 1 or 2")
    photons = _photons(zones, references.reshape(-1, 4, REFERENCE_BINS).sum(axis=1), mode, stamp_ns, shift, steps)
    if mode != 2 or not zones.any() or (zones != zones[:, :1]).any():
        return photons
    # Seen in a log of the logger's version 4: all histograms of its row y are that of zone y of row 0.
    sensor = photons.sensor.replace(rows=1, irf=photons.sensor.irf[:zones.shape[1]])
    row = PhotonHistograms(photons.frame.counts[None, :, 0].copy(), stamp_ns)
    return Photons(sensor, row, None, NAME, (NOTE, "a fault of the logger: the log has the histograms of row 0 only"))


def decode(message: bytes, stamp_ns: int) -> Photons | None:
    """The histograms in a message of the publisher, stamped so; None if it has results only.

    Raises:
        InvalidInput: no such message, or one without all histograms of its measurement.
    """
    require(len(message) >= CONTAINER and struct.unpack_from("<I", message)[0] == MAGIC, "message",
            f"{len(message)} bytes", "a container of the TMF8829 publisher (0xFE5E1234, 84 bytes, frames)")
    at, found, mode = CONTAINER, {}, None
    while at < len(message):
        require(at + BEFORE + HEADER <= len(message), "message", f"cut off at byte {at}", "whole frames")
        kind, part, payload = struct.unpack_from("<BBH", message, at + BEFORE)
        size = REFERENCE if kind & 0xF0 == REFERENCE_SPADS else 4 + payload
        frame, at = message[at + BEFORE:at + BEFORE + size], at + BEFORE + size
        require(len(frame) == size >= HEADER + FOOTER, "message", f"cut off in frame 0x{kind:02x}", "whole frames")
        if kind & 0xF0 == HISTOGRAMS:
            mode = kind & 0x0F
            require(mode in SIZES and part < _parts(mode), "message", f"mode {mode}, part {part}", "modes 0 to 5")
            found[part] = frame[HEADER:size - FOOTER]
    if not found:
        return None
    require(len(found) == _parts(mode), "message", f"{len(found)} histogram frames", f"the {_parts(mode)} of its mode")
    return _assembled(found, mode, stamp_ns)


def _assembled(found: dict[int, bytes], mode: int, stamp_ns: int) -> Photons:
    zones = np.zeros((*SIZES[mode], 256 >> _shift(mode)), np.int32)
    references = np.zeros((len(found), REFERENCE_BINS), np.int32)
    for part, data in found.items():
        into = zones[_places(part, mode)]
        wanted = 3 * (4 * REFERENCE_BINS + into.size)
        require(len(data) == wanted, "message histograms", f"{len(data)} bytes", f"{wanted} bytes")
        values = np.frombuffer(data, np.uint8).reshape(-1, 3) @ np.array([1, 1 << 8, 1 << 16], np.int32)
        references[part] = values[:4 * REFERENCE_BINS].reshape(4, -1).sum(axis=0)
        into[:] = values[4 * REFERENCE_BINS:].reshape(into.shape)
    return _photons(zones, references, mode, stamp_ns, _shift(mode), MEASURED)


def _photons(zones: np.ndarray, references: np.ndarray, mode: int, stamp_ns: int, shift: int, steps: int) -> Photons:
    """Zones [rows, cols, bins], each bin 2^shift steps wide, and the references [parts, 64] of their parts."""
    rows, cols, bins = zones.shape
    bins = min(steps >> shift, bins)        # the last whole one
    of_part = np.zeros((rows, cols), np.intp)
    for part in range(len(references)):
        of_part[_places(part, mode)] = part
    pulses = np.repeat(references, 1 << (2 - shift), axis=1)[:, :bins]      # as wide as the zones' bins
    peak = int(pulses.sum(axis=0).argmax())
    projection = Pinhole(0.75 * cols, rows, (cols - 1) / 2, (rows - 1) / 2)
    sensor = SensorModel(rows, cols, bins, CONVERTER_S * 2**shift, pulses[of_part.ravel()], peak,
                         toa_offset_bins=-peak, projection=projection, frame_id=NAME)
    frame = PhotonHistograms(np.ascontiguousarray(zones[..., :bins]), stamp_ns)
    return Photons(sensor, frame, None, NAME, (NOTE,))


def _shift(mode: int) -> int:
    """log₂ of the converter's steps in a bin: 256 bins in the 8 × 8 modes, 64 in the others."""
    return 0 if mode < 2 else 2


def _step(mode: int) -> int:
    """Columns from one zone of a part to the next."""
    return {3: 2, 4: 2, 5: 3}.get(mode, 1)


def _parts(mode: int) -> int:
    """Histogram frames of a measurement."""
    return 2 * _step(mode) * max(SIZES[mode][0] // 16, 1)


def _places(part: int, mode: int) -> tuple[slice, slice]:
    """The zones of a part: in turn the left and the right half, then the columns between, then the rows between."""
    (rows, cols), step = SIZES[mode], _step(mode)
    first = part % 2 * (cols // 2)
    return slice(part // (2 * step), None, max(rows // 16, 1)), slice(first + part // 2 % step, first + cols // 2, step)
