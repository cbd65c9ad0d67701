"""`depth`, `intensity`, `background`: an array with one number per pixel ⇄ Image (msg_schemas/images.json)."""

import numpy as np

from srt3d_ros.messages import cdr
from srt3d_ros.messages.packing import pack_image, unpack_image


def encode_cdr(image: np.ndarray, stamp_ns: int, frame_id: str) -> bytes:
    """The serialised message of an image, float32 [rows, cols], NaN = missing."""
    return cdr.write_image(pack_image(cdr.Header(stamp_ns, frame_id), image[:, :, None], "images"))


def decode_cdr(raw: bytes) -> tuple[cdr.Header, np.ndarray]:
    """The header and the image of a message, float32 [rows, cols], a copy; InvalidInput if it breaks the schema."""
    image = cdr.read_image(raw)
    return image.header, np.array(unpack_image(image, "images")[:, :, 0], dtype=np.float32, order="C")
