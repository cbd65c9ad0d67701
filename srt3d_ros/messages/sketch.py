"""`sketch`: Sketch ⇄ PointCloud2 (msg_schemas/sketch.json), and `sketch/sensor` (msg_schemas/sketch_sensor.json)."""

from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch, check_frequencies
from srt3d_ros.errors import require
from srt3d_ros.messages import cdr, coded_sketch, json_text
from srt3d_ros.messages import sensor as sensor_codec
from srt3d_ros.messages.packing import pack_cloud, unpack_cloud
from srt3d_ros.messages.schema import cloud_layouts

if TYPE_CHECKING:
    from std_msgs.msg import String

INT16_SCALE = 32_767
COUNTS = np.dtype([("photons", "<u4")])
MAX_MODULUS = 1.001     # a mean of unit vectors is at most 1 long; the rest is for rounding


def encode_cdr(sketch: Sketch, frame_id: str, layout: str = "float32",
               coding_step: float = coded_sketch.DEFAULT_STEP) -> bytes:
    """The serialised message of a sketch.

    Args:
        sketch: of one frame or window.
        frame_id: the sensor's tf frame.
        layout: "float32"; "int16" for half the bytes, or "coded" for a tenth.
        coding_step: of "coded", in standard deviations of photon noise.

    Raises:
        InvalidInput: the sketch is not one of photons: a mean longer than 1, or not a number.
    """
    layouts = cloud_layouts("sketch", len(sketch.frequencies))
    header = cdr.Header(sketch.stamp_ns, frame_id)
    if layout == "coded":
        points = np.frombuffer(coded_sketch.encode(sketch, coding_step), layouts[layout])
        return cdr.write_cloud(pack_cloud(header, points))
    points = np.zeros(sketch.photons.shape, layouts[layout])
    points["photons"] = sketch.photons
    means = np.ascontiguousarray(sketch.z, np.complex64)
    _check_means(means)
    numbers = means.view(np.float32)
    points["sketch"] = np.rint(numbers * INT16_SCALE) if layout == "int16" else numbers
    return cdr.write_cloud(pack_cloud(header, points))


def decode_cdr(raw: bytes, frequencies: tuple[int, ...], sensor: SensorModel | None = None
               ) -> tuple[cdr.Header, Sketch]:
    """The sketch of a serialised message in any layout.

    Args:
        raw: from `sketch`.
        frequencies: the k_l from `sketch/sensor`.
        sensor: if given, the message must have its rows and columns.

    Raises:
        InvalidInput: the message does not keep the schema, fit the frequencies or fit the sensor.
    """
    cloud = cdr.read_cloud(raw)
    if (coded := _coded(cloud)) is not None:
        shape = sensor and (sensor.rows, sensor.cols)
        photons, sums, added_variance = coded_sketch.decode(coded, tuple(frequencies), shape)
        return cloud.header, Sketch(tuple(frequencies), sums, photons, cloud.header.stamp_ns, added_variance)
    for name, count, wanted in (("height", cloud.height, sensor and sensor.rows),
                                ("width", cloud.width, sensor and sensor.cols)):
        require(count > 0, name, count, "1 or more")
        require(wanted in (None, count), name, count, f"the sensor's {wanted}")
    layouts = cloud_layouts("sketch", len(frequencies))
    points = unpack_cloud(cloud, [layouts["float32"], layouts["int16"]])
    photons = points["photons"].astype(np.uint32)
    numbers = np.array(points["sketch"], np.float32, order="C")
    if points["sketch"].dtype.kind == "i":
        numbers /= INT16_SCALE
    _check_means(numbers.view(np.complex64))
    numbers *= photons[..., None].astype(np.float32)
    return cloud.header, Sketch(tuple(frequencies), numbers.view(np.complex64), photons, cloud.header.stamp_ns)


def decode_counts_cdr(raw: bytes) -> tuple[cdr.Header, np.ndarray]:
    """The photons of each pixel, uint32 [rows, cols], of a serialised message, without a copy of its means.

    Raises:
        InvalidInput: the message is no cloud with photon counts.
    """
    cloud = cdr.read_cloud(raw)
    if (coded := _coded(cloud)) is not None:
        return cloud.header, coded_sketch.decode_counts(coded)
    return cloud.header, unpack_cloud(cloud, [COUNTS])["photons"]


def encode_sensor(sensor: SensorModel, frequencies: tuple[int, ...], window_frames: int) -> "String":
    """The `sketch/sensor` message, which says what the numbers of `sketch` are."""
    from std_msgs.msg import String

    return String(data=json_text.dump({
        "schema_version": 1, "frequencies": list(frequencies), "window_frames": window_frames,
        "sensor": sensor_codec.to_object(sensor)}))


def decode_sensor(message: "String") -> tuple[SensorModel, tuple[int, ...], int]:
    """The sensor, the frequencies k_l and the window of a `sketch/sensor` message.

    Raises:
        InvalidInput: the message does not keep the schema.
    """
    content = json_text.parse(message.data, "sketch/sensor")
    json_text.check(content, "sketch_sensor")
    sensor = sensor_codec.from_object(content["sensor"])
    return sensor, check_frequencies(content["frequencies"], sensor.num_bins), content["window_frames"]


def decode_sensor_cdr(raw: bytes) -> tuple[SensorModel, tuple[int, ...], int]:
    """`decode_sensor` of a serialised message."""
    return decode_sensor(SimpleNamespace(data=cdr.read_text(raw)))


def _coded(cloud: cdr.Cloud) -> bytes | None:
    """The bytes of a sketch in the layout coded; None if it is another."""
    layout = cloud_layouts("sketch")["coded"]
    if {field.name for field in cloud.fields}.isdisjoint(layout.names):
        return None
    require(cloud.height == 1, "height", cloud.height, "1 with the field coded")
    return unpack_cloud(cloud, [layout]).tobytes()


def _check_means(means: np.ndarray) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        longest = float(np.abs(means).max(initial=0))       # a NaN makes it NaN
    require(longest <= MAX_MODULUS, "sketch", longest, "means of unit vectors, |z| ≤ 1, everywhere")
