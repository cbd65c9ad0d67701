"""`depth`, `intensity`, `background`: one number a pixel ⇄ Image (msg_schemas/images.json)."""

import numpy as np
from sensor_msgs.msg import Image

from srt3d_ros.errors import require
from srt3d_ros.messages import cdr, typed
from srt3d_ros.messages.header import Header
from srt3d_ros.messages.packing import pack_image, unpack_image
from srt3d_ros.messages.schema import load


def encode(image: np.ndarray, stamp_ns: int, frame_id: str) -> Image:
    """The message of an image float32 [rows, cols], NaN = missing."""
    return typed.to_image_message(_pack(image, stamp_ns, frame_id))


def encode_cdr(image: np.ndarray, stamp_ns: int, frame_id: str) -> bytes:
    """`encode`, serialised."""
    return cdr.write_image(_pack(image, stamp_ns, frame_id))


def decode(message: Image) -> tuple[Header, np.ndarray]:
    """The image of a message, float32 [rows, cols], copied; InvalidInput if it does not keep the schema."""
    return _unpack(typed.from_image_message(message))


def decode_cdr(raw: bytes) -> tuple[Header, np.ndarray]:
    """`decode` of a serialised message."""
    return _unpack(cdr.read_image(raw))


def _pack(image: np.ndarray, stamp_ns: int, frame_id: str) -> cdr.Image:
    require(image.ndim == 2 and image.dtype == np.float32, "image", f"{image.dtype} {image.shape}",
            "float32 [rows, cols]")
    return pack_image(Header(stamp_ns, frame_id), image, load("images"))


def _unpack(image: cdr.Image) -> tuple[Header, np.ndarray]:
    return image.header, np.array(unpack_image(image, load("images")), dtype=np.float32, order="C")
