"""Images: one number per pixel ⇄ Image, and the pinhole camera → CameraInfo (msg_schemas/images.json)."""

from dataclasses import astuple

import numpy as np
from builtin_interfaces.msg import Time
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header as HeaderMessage

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.messages import cdr
from srt3d_ros.messages.packing import encode_image, unpack_image

MODEL = "plumb_bob"     # five coefficients: k1, k2, p1, p2, k3


def encode_cdr(image: np.ndarray, stamp_ns: int, frame_id: str) -> bytes:
    """The serialised message of an image, float32 [rows, cols], NaN = missing, +Inf = empty."""
    return encode_image(image[:, :, None], "images", stamp_ns, frame_id)


def decode_cdr(raw: bytes) -> tuple[cdr.Header, np.ndarray]:
    """The header and the image of a message, float32 [rows, cols], a copy; InvalidInput if it breaks the schema."""
    image = cdr.Image.read(raw)
    return image.header, np.array(unpack_image(image, "images")[:, :, 0], dtype=np.float32, order="C")


def camera_info(sensor: SensorModel, stamp_ns: int, frame_id: str) -> CameraInfo | None:
    """The CameraInfo for images of the sensor's pixels; None if the sensor is no pinhole camera.

    Images are not rectified: D and K are those of the lens, R is the identity, and P = K keeps the scale of a rectified
    image. RViz's depth cloud, which assumes rectified images, ignores D.
    """
    lens = sensor.projection
    if not isinstance(lens, Pinhole):
        return None
    k = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]], np.float64)
    p = np.column_stack([k, np.zeros(3)])
    sec, nanosec = divmod(stamp_ns, cdr.NS_PER_S)
    stamp = Time(sec=sec, nanosec=nanosec)
    return CameraInfo(header=HeaderMessage(stamp=stamp, frame_id=frame_id), height=sensor.rows, width=sensor.cols,
                      distortion_model=MODEL, d=[float(value) for value in astuple(lens.distortion)], k=k.ravel(),
                      r=np.eye(3).ravel(), p=p.ravel())
