"""`camera_info`: Pinhole ⇄ CameraInfo, as sensor_msgs/CameraInfo.msg defines it (msg_schemas/images.json)."""

from dataclasses import astuple

import numpy as np
from builtin_interfaces.msg import Time
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header as HeaderMessage

from srt3d_ros.core.distortion import PlumbBob
from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import MAX_PIXELS, MAX_SIDE, SensorModel
from srt3d_ros.errors import require
from srt3d_ros.messages.cdr import Header

MODEL = "plumb_bob"
COEFFICIENTS = 5            # k1, k2, p1, p2, k3; of four, k3 is 0


def camera_info(sensor: SensorModel, stamp_ns: int, frame_id: str) -> CameraInfo | None:
    """The camera beside an image of the sensor's pixels; None for a sensor that is no pinhole camera.

    The images are as the sensor sees them, not rectified: D and K are the lens's; R is the identity and P is K, so that
    a rectified image keeps the scale. What takes an image for rectified (RViz's depth cloud) is right but for D.
    """
    lens = sensor.projection
    if not isinstance(lens, Pinhole):
        return None
    k = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]], np.float64)
    p = np.column_stack([k, np.zeros(3)])
    header = Header(stamp_ns, frame_id)
    stamp = Time(sec=header.sec, nanosec=header.nanosec)
    return CameraInfo(header=HeaderMessage(stamp=stamp, frame_id=frame_id), height=sensor.rows, width=sensor.cols,
                      distortion_model=MODEL, d=[float(value) for value in astuple(lens.distortion)], k=k.ravel(),
                      r=np.eye(3).ravel(), p=p.ravel())


def decode_camera_info(message: CameraInfo) -> tuple[int, int, Pinhole]:
    """Rows, columns and pinhole of the raw image that a CameraInfo stands beside; the camera must be calibrated.

    K is that of the full resolution: the roi moves its principal point, then the binning, which sums binning_x ×
    binning_y pixels into one, scales it. The centre of such a pixel is the middle of those that it sums (image_geometry
    leaves out the (binning − 1) / 2 pixels between that and the centre of the first). R and P, of the rectified image,
    are not used.

    Raises:
        InvalidInput: one line that names the field: not calibrated, a model other than plumb_bob, an impossible roi, a
            distortion that cannot be taken off.
    """
    fx, fy, cx, cy = _matrix(message)
    left, cols, step_x = _side(message, "width", message.roi.x_offset, message.binning_x)
    top, rows, step_y = _side(message, "height", message.roi.y_offset, message.binning_y)
    lens = Pinhole(fx / step_x, fy / step_y, (cx - left - (step_x - 1) / 2) / step_x,
                   (cy - top - (step_y - 1) / 2) / step_y, _distortion(message))
    require(rows * cols <= MAX_PIXELS, "camera_info.width × height", f"{cols} × {rows}", f"at most {MAX_PIXELS} pixels")
    lens.check(rows, cols)
    return rows, cols, lens


def _matrix(message: CameraInfo) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy of the full resolution."""
    k = np.asarray(message.k, np.float64)
    shown = " ".join(f"{value:g}" for value in k)
    require(bool(k.any()), "camera_info.k", "all 0", "a calibrated camera (camera_calibration makes K and D)")
    require(bool(np.isfinite(k).all()), "camera_info.k", shown, "finite numbers")
    fx, skew, cx, zero_1, fy, cy, zero_2, zero_3, one = k.tolist()
    require((skew, zero_1, zero_2, zero_3, one) == (0, 0, 0, 0, 1), "camera_info.k", shown, "fx 0 cx 0 fy cy 0 0 1")
    require(fx > 0 and fy > 0, "camera_info.k", shown, "focal lengths fx, fy above 0 pixels")
    return fx, fy, cx, cy


def _side(message: CameraInfo, side: str, offset: int, binning: int) -> tuple[int, int, int]:
    """Along "width" or "height": the first pixel seen, the pixels of the image, and those summed in each."""
    roi, whole, step = message.roi, getattr(message, side), max(binning, 1)
    require(1 <= whole <= MAX_SIDE, f"camera_info.{side}", whole, f"the calibrated image's pixels, 1 to {MAX_SIDE}")
    everything = not any((roi.x_offset, roi.y_offset, roi.width, roi.height))
    seen = whole if everything else getattr(roi, side)
    require(1 <= seen <= whole - offset, f"camera_info.roi.{side}", f"{seen} from pixel {offset} on",
            f"1 or more, within the {whole} pixels of the full resolution")
    require(seen >= step, f"camera_info.binning_{'x' if side == 'width' else 'y'}", step, f"at most {seen} pixels")
    return offset, seen // step, step


def _distortion(message: CameraInfo) -> PlumbBob:
    d, model = [float(value) for value in message.d], message.distortion_model
    if model == "" and not any(d):
        return PlumbBob()
    require(model == MODEL, "camera_info.distortion_model", model, f"{MODEL}, or none and no coefficients")
    require(len(d) in (0, COEFFICIENTS - 1, COEFFICIENTS), "camera_info.d", f"{len(d)} coefficients",
            "k1, k2, p1, p2, k3, or none")
    return PlumbBob(*d)
