"""Decode the messages that ams' Python driver of the TMF8829 publishes with ZeroMQ (port 5558).

    https://github.com/ams-OSRAM/tmf8829_driver_python: tmf8829/zeromq/TMF8829_zeromq_protocol.md

A message is a container header of 84 bytes, then frames: 5 bytes of the host, a header of 16, data, a footer of 12.
Bins have 24 bits. Written from the driver's source, not tried with a device. In dual mode, the last frames are used.
"""
import struct

import numpy as np

from srt3d_ros.datasets.readers import tmf8829
from srt3d_ros.datasets.readers.tmf8829 import REFERENCE_BINS, SIZES, parts_of, shift_of
from srt3d_ros.datasets.reading import Reading
from srt3d_ros.errors import require

MAGIC, CONTAINER, BEFORE, HEADER, FOOTER, REFERENCE = 0xFE5E1234, 84, 5, 16, 12, 60   # bytes
HISTOGRAMS, REFERENCE_SPADS = 0x20, 0x30


def decode(message: bytes, stamp_ns: int) -> Reading | None:
    """The histograms in a message, with this stamp; None if the message has results only.

    Raises:
        InvalidInput: not a message of the publisher, or histograms of the measurement are missing.
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
            require(mode in SIZES and part < parts_of(mode), "message", f"mode {mode}, part {part}", "modes 0 to 5")
            found[part] = frame[HEADER:size - FOOTER]
    if not found:
        return None
    parts = parts_of(mode)
    require(len(found) == parts, "message", f"{len(found)} histogram frames", f"the {parts} of its mode")
    return _assembled(found, mode, stamp_ns)


def _assembled(found: dict[int, bytes], mode: int, stamp_ns: int) -> Reading:
    zones = np.zeros((*SIZES[mode], 256 >> shift_of(mode)), np.int32)
    references = np.zeros((len(found), REFERENCE_BINS), np.int32)
    for part, data in found.items():
        into = zones[tmf8829.zones_of(part, mode)]
        wanted = 3 * (4 * REFERENCE_BINS + into.size)
        require(len(data) == wanted, "message histograms", f"{len(data)} bytes", f"{wanted} bytes")
        values = np.frombuffer(data, np.uint8).reshape(-1, 3) @ np.array([1, 1 << 8, 1 << 16], np.int32)
        references[part] = values[:4 * REFERENCE_BINS].reshape(4, -1).sum(axis=0)
        into[:] = values[4 * REFERENCE_BINS:].reshape(into.shape)
    return tmf8829.photons_of(zones, references, mode, stamp_ns, shift_of(mode), tmf8829.MEASURED)
