"""`gates`: PhotonGates ⇄ Image, the ToA words of G laser cycles (msg_schemas/gates.json)."""

from typing import TYPE_CHECKING

import numpy as np

from srt3d_ros.core.photons import CHUNK, PhotonGates, last_word, word_wanted
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.messages import cdr, typed
from srt3d_ros.messages.header import Header
from srt3d_ros.messages.packing import pack_image, unpack_image
from srt3d_ros.messages.schema import load

if TYPE_CHECKING:
    from sensor_msgs.msg import Image


def encode(gates: PhotonGates, sensor: SensorModel, frame_id: str) -> "Image":
    """The message of G cycles.

    Raises:
        InvalidInput: the words do not fit the sensor, or the sensor has no `gates`.
    """
    return typed.to_image_message(_pack(gates, sensor, frame_id))


def encode_cdr(gates: PhotonGates, sensor: SensorModel, frame_id: str) -> bytes:
    """`encode`, serialised."""
    return cdr.write_image(_pack(gates, sensor, frame_id))


def decode(message: "Image", sensor: SensorModel) -> tuple[Header, PhotonGates]:
    """The words of a message: a read-only view of it, or a copy where its bytes lie otherwise.

    Raises:
        InvalidInput: the message does not keep the schema or fit the sensor, or the sensor has no `gates`.
    """
    return _unpack(typed.from_image_message(message), sensor)


def decode_cdr(raw: bytes, sensor: SensorModel) -> tuple[Header, PhotonGates]:
    """`decode` of a serialised message."""
    return _unpack(cdr.read_image(raw), sensor)


def _pack(gates: PhotonGates, sensor: SensorModel, frame_id: str) -> cdr.Image:
    cycles, rows, cols = gates.words.shape
    require((rows, cols) == (sensor.rows, sensor.cols), "gates shape", gates.words.shape,
            f"[cycles, {sensor.rows}, {sensor.cols}]")
    _check_words(gates.words, sensor)
    return pack_image(Header(gates.stamp_ns, frame_id), gates.words.reshape(cycles * rows, cols), load("gates"))


def _unpack(image: cdr.Image, sensor: SensorModel) -> tuple[Header, PhotonGates]:
    require(image.width == sensor.cols, "width", image.width, f"the sensor's {sensor.cols} columns")
    require(image.height % sensor.rows == 0, "height", image.height, f"a multiple of the sensor's {sensor.rows} rows")
    # A copy only where it has to be: of 300 MB/s each one costs a tenth of a core.
    words = np.require(unpack_image(image, load("gates")), np.uint16, ["C_CONTIGUOUS", "ALIGNED"])
    words = words.reshape(image.height // sensor.rows, sensor.rows, sensor.cols)
    photons = _check_words(words, sensor)
    return image.header, PhotonGates(words, image.header.stamp_ns, photons)


def _check_words(words: np.ndarray, sensor: SensorModel) -> int:
    """How many of the words are photons; InvalidInput if one is neither a photon nor none."""
    require(sensor.gates is not None, "sensor.gates", "absent", "first_word and no_detection, to read `gates` with")
    first, none = sensor.gates.first_word, sensor.gates.no_detection
    last = last_word(sensor)
    flat, photons = words.reshape(-1), 0
    for part in (flat[start:start + CHUNK] for start in range(0, len(flat), CHUNK)):
        # Unsigned: a word below `first` wraps around to more than any bin.
        seen = part != none
        wrong = (part - np.uint16(first) > last - first) & seen
        if wrong.any():
            raise InvalidInput("gates word", int(part[wrong.argmax()]), word_wanted(sensor))
        photons += int(np.count_nonzero(seen))
    return photons
