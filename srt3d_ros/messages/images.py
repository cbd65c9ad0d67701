"""`depth`, `intensity`, `background`: one number a pixel ⇄ Image, and CameraInfo (msg_schemas/images.json)."""

import numpy as np
from sensor_msgs.msg import CameraInfo, Image

from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import require
from srt3d_ros.messages import cdr, typed
from srt3d_ros.messages.header import Header
from srt3d_ros.messages.layout import pack_image, unpack_image
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


def camera_info(sensor: SensorModel, stamp_ns: int, frame_id: str) -> CameraInfo | None:
    """The camera beside an image, without distortion; None for a sensor that is no pinhole camera."""
    lens = sensor.projection
    if not isinstance(lens, Pinhole):
        return None
    k = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]], np.float64)
    p = np.column_stack([k, np.zeros(3)])
    return CameraInfo(header=typed.to_header_message(Header(stamp_ns, frame_id)), height=sensor.rows, width=sensor.cols,
                      distortion_model="plumb_bob", d=[0.0] * 5, k=k.ravel(), r=np.eye(3).ravel(), p=p.ravel())


def _pack(image: np.ndarray, stamp_ns: int, frame_id: str) -> cdr.Image:
    require(image.ndim == 2 and image.dtype == np.float32, "image", f"{image.dtype} {image.shape}",
            "float32 [rows, cols]")
    return pack_image(Header(stamp_ns, frame_id), image, load("images"))


def _unpack(image: cdr.Image) -> tuple[Header, np.ndarray]:
    return image.header, np.array(unpack_image(image, load("images")), dtype=np.float32, order="C")
