"""Fuzz targets of messages: what DDS or a bag hands to each codec."""

from pathlib import Path
from types import SimpleNamespace

from robustness.targets import Defect, Made, Target
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.messages import camera, cdr, gates, images, photons, points, sensor, sketch

GOLDEN = Path(__file__).resolve().parents[1] / "tests" / "messages" / "golden"
FREQUENCIES = (1, 3)        # of the golden sketches
SENSOR_TEXTS = [(GOLDEN / f"{name}.json").read_bytes() for name in ("sensor", "sensor_lens")]


def golden_sensor() -> SensorModel:
    """The sensor of the golden messages."""
    return SensorModel(rows=3, cols=4, num_bins=100, bin_width_s=1e-10, irf=[1, 2, 1], gates=GateWords(10, 65_535))


def _photons() -> Made:
    described = golden_sensor()

    def read(raw: bytes) -> None:
        events, again = _read_twice(photons, raw, described)
        _check_same(events.pixel.tobytes() + events.toa.tobytes(), again.pixel.tobytes() + again.toa.tobytes())
        cdr.restamp(raw, cdr.stamp_ns(raw))

    return read, _golden("photons_uint16", "photons_uint32", "photons_float32")


def _gates() -> Made:
    described = golden_sensor()

    def read(raw: bytes) -> None:
        frame, again = _read_twice(gates, raw, described)
        _check_same(frame.words.tobytes(), again.words.tobytes())
        frame.to_events(described).check(described)

    return read, _golden("gates")


def _sketch() -> Made:
    described = golden_sensor()

    def read(raw: bytes) -> None:
        _, made = sketch.decode_cdr(raw, FREQUENCIES, described)
        _check_same(made.photons.tobytes(), sketch.decode_counts_cdr(raw)[1].astype(made.photons.dtype).tobytes())

    return read, _golden("sketch_float32", "sketch_int16")


def _points() -> Made:
    return points.decode_cdr, _golden("points_xyzi", "points_full", "points_xyzi_organised", "points_full_organised")


def _images() -> Made:
    def read(raw: bytes) -> None:
        header, image = images.decode_cdr(raw)
        again = images.decode_cdr(images.encode_cdr(image, header.stamp_ns, header.frame_id))
        _check_same((header, image.tobytes()), (again[0], again[1].tobytes()))

    return read, _golden("image_32FC1")


def _sensor() -> Made:
    def read(raw: bytes) -> None:
        described = sensor.from_json(raw.decode(errors="replace"))
        if not sensor.from_json(sensor.to_json(described)).same_as(described):
            raise Defect("a sensor changes when it is written and read again")

    return read, SENSOR_TEXTS


def _sketch_sensor() -> Made:
    def read(raw: bytes) -> None:
        sketch.decode_sensor(SimpleNamespace(data=raw.decode(errors="replace")))

    return read, [sketch.encode_sensor(golden_sensor(), FREQUENCIES, 3).data.encode()]


def _camera_info() -> Made:
    from rclpy.serialization import deserialize_message, serialize_message
    from sensor_msgs.msg import CameraInfo

    def read(raw: bytes) -> None:
        try:
            message = deserialize_message(raw, CameraInfo)
        except Exception:       # the middleware refuses it: no node ever sees it
            return
        camera.decode_camera_info(message)

    described = [camera.camera_info(sensor.from_json(text.decode()), 5, "lidar") for text in SENSOR_TEXTS]
    return read, [serialize_message(message) for message in described if message is not None]


def _golden(*names: str) -> list[bytes]:
    return [bytes.fromhex((GOLDEN / f"{name}.hex").read_text()) for name in names]


def _read_twice(codec, raw: bytes, described: SensorModel) -> tuple:
    """The frame in the bytes, and the frame after it was written and read again."""
    header, frame = codec.decode_cdr(raw, described)
    header_again, again = codec.decode_cdr(codec.encode_cdr(frame, described, header.frame_id), described)
    _check_same(header, header_again)
    return frame, again


def _check_same(one, other) -> None:
    if one != other:
        raise Defect("a frame changes when it is written and read again")


TARGETS = (
    Target("photons", _photons, 200_000), Target("gates", _gates, 200_000), Target("sketch", _sketch, 150_000),
    Target("points", _points, 200_000), Target("images", _images, 200_000), Target("sensor", _sensor, 100_000),
    Target("sketch_sensor", _sketch_sensor, 100_000), Target("camera_info", _camera_info, 100_000),
)
