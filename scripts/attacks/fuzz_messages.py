"""The doors of messages: what DDS or a bag hands to each codec."""

from pathlib import Path
from types import SimpleNamespace

from fuzz_doors import Defect, Door

from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.messages import camera, cdr, gates, images, photons, points, sensor, sketch

GOLDEN = Path(__file__).resolve().parents[2] / "tests" / "messages" / "golden"
FREQUENCIES = (1, 3)        # of the golden sketches


def _golden(*names: str) -> list[bytes]:
    return [bytes.fromhex((GOLDEN / f"{name}.hex").read_text()) for name in names]


def golden_sensor() -> SensorModel:
    """The one that the golden messages are of."""
    return SensorModel(rows=3, cols=4, num_bins=100, bin_width_s=1e-10, irf=[1, 2, 1], gates=GateWords(10, 65_535))


def _photons():
    described = golden_sensor()

    def read(raw: bytes) -> None:
        events, again = _read_twice(photons, raw, described)
        _same(events.pixel.tobytes() + events.toa.tobytes(), again.pixel.tobytes() + again.toa.tobytes())
        cdr.restamp(raw, cdr.stamp_ns(raw))

    return read, _golden("photons_uint16", "photons_uint32", "photons_float32")


def _gates():
    described = golden_sensor()

    def read(raw: bytes) -> None:
        frame, again = _read_twice(gates, raw, described)
        _same(frame.words.tobytes(), again.words.tobytes())
        frame.to_events(described).check(described)

    return read, _golden("gates")


def _sketch():
    described = golden_sensor()

    def read(raw: bytes) -> None:
        _, made = sketch.decode_cdr(raw, FREQUENCIES, described)
        _same(made.photons.tobytes(), sketch.decode_counts_cdr(raw)[1].astype(made.photons.dtype).tobytes())

    return read, _golden("sketch_float32", "sketch_int16")


def _points():
    return points.decode_cdr, _golden("points_xyzi", "points_full", "points_xyzi_organised", "points_full_organised")


def _images():
    def read(raw: bytes) -> None:
        header, image = images.decode_cdr(raw)
        again = images.decode_cdr(images.encode_cdr(image, header.stamp_ns, header.frame_id))
        _same(header, again[0])
        _same(image.tobytes(), again[1].tobytes())

    return read, _golden("image_32FC1")


def sensor_texts() -> list[bytes]:
    return [(GOLDEN / f"{name}.json").read_bytes() for name in ("sensor", "sensor_lens")]


def _sensor_json():
    def read(raw: bytes) -> None:
        described = sensor.from_json(_text(raw))
        if not sensor.from_json(sensor.to_json(described)).same_as(described):
            raise Defect("a sensor that changes when it is written and read again")

    return read, sensor_texts()


def _sketch_sensor():
    described = golden_sensor()

    def read(raw: bytes) -> None:
        sketch.decode_sensor(SimpleNamespace(data=_text(raw)))

    return read, [sketch.encode_sensor(described, FREQUENCIES, 3).data.encode()]


def _camera_info():
    from rclpy.serialization import deserialize_message, serialize_message
    from sensor_msgs.msg import CameraInfo

    def read(raw: bytes) -> None:
        try:
            message = deserialize_message(raw, CameraInfo)
        except Exception:       # the middleware refuses it: no node ever sees it
            return
        camera.decode_camera_info(message)

    described = [camera.camera_info(sensor.from_json(text.decode()), 5, "lidar") for text in sensor_texts()]
    return read, [serialize_message(message) for message in described if message is not None]


def _text(raw: bytes) -> str:
    return raw.decode(errors="replace")


def _read_twice(codec, raw: bytes, described: SensorModel) -> tuple:
    """What a frame's bytes say, and what they say once it was written and read again."""
    header, frame = codec.decode_cdr(raw, described)
    header_again, again = codec.decode_cdr(codec.encode_cdr(frame, described, header.frame_id), described)
    _same(header, header_again)
    return frame, again


def _same(one, other) -> None:
    if one != other:
        raise Defect("what was read changes when it is written and read again")


DOORS = (
    Door("photons", _photons, 200_000), Door("gates", _gates, 200_000), Door("sketch", _sketch, 150_000),
    Door("points", _points, 200_000), Door("images", _images, 200_000), Door("sensor", _sensor_json, 100_000),
    Door("sketch_sensor", _sketch_sensor, 100_000), Door("camera_info", _camera_info, 100_000),
)
