"""`sketch`: Sketch ⇄ PointCloud2, whose field names give frequencies, T and description (msg_schemas/sketch.json)."""

import re

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sums import PhaseSums, check_frequencies
from srt3d_ros.errors import require
from srt3d_ros.messages import cdr
from srt3d_ros.messages.packing import CODES, encode_cloud, unpack_cloud
from srt3d_ros.messages.schema_files import fields_of
from srt3d_ros.messages.sensor_message import digest

INT16_SCALE = 32_767
NUMBERS = {"float32": np.dtype("<f4"), "int16": np.dtype("<i2")}
COUNTS = np.dtype([("photons", "<u4")])
FREQUENCY, PERIOD, DESCRIPTION, CYCLES = map(re.compile, (
    r"k([1-9]\d{0,4})", r"T([1-9]\d{0,4})", r"sensor_([0-9a-f]{8})", r"cycles_([1-9]\d{0,14})"))
MAX_MODULUS = 1.001     # the mean of unit vectors has |z| ≤ 1; 0.001 allows for rounding


def encode_cdr(sketch: PhaseSums, frame_id: str, layout: str = "float32") -> bytes:
    """The serialised message of a sketch.

    Args:
        sketch: of one frame or window; its sensor is described on `sketch/sensor`.
        frame_id: the sensor's tf frame.
        layout: "float32", or "int16" for half the bytes.

    Raises:
        InvalidInput: a mean is NaN or longer than 1, which no sketch of photons has.
    """
    names = [f"k{k}" for k in sketch.frequencies]
    points = np.zeros(sketch.photons.shape, _point(names, layout, sketch.before is not None))
    points["photons"] = sketch.photons
    if sketch.before is not None:
        points["before"] = sketch.before
    means = np.ascontiguousarray(sketch.z, np.complex64)
    _check_means(means)
    parts = means.view(np.float32)
    _parts(points, names)[:] = np.rint(parts * INT16_SCALE) if layout == "int16" else parts
    markers = [f"T{sketch.sensor.num_bins}", f"sensor_{digest(sketch.sensor)}"]
    if sketch.cycles:
        markers.append(f"cycles_{sketch.cycles}")
    return encode_cloud(points, sketch.stamp_ns, frame_id,
                        further=(cdr.Field(name, 0, CODES[np.dtype("u1")], 1) for name in markers))


def description_of(cloud: cdr.CloudMessage) -> str:
    """The digest (`sensor_message.digest`) of the description that a sketch names; InvalidInput if it names none."""
    return _named(cloud, DESCRIPTION, "sensor_DIGEST")


def decode_cdr(raw: bytes, sensor: SensorModel) -> tuple[cdr.Header, PhaseSums]:
    """The header and the sketch of a serialised message; `decode` says how."""
    cloud = cdr.CloudMessage.read(raw)
    return cloud.header, decode(cloud, sensor)


def decode(cloud: cdr.CloudMessage, sensor: SensorModel) -> PhaseSums:
    """The sketch of a message in any layout.

    Args:
        cloud: the message, from `CloudMessage.read`.
        sensor: of the description that it names (`description_of`).

    Raises:
        InvalidInput: the message breaks the schema or does not fit the sensor.
    """
    num_bins = int(_named(cloud, PERIOD, "T"))
    require(num_bins == sensor.num_bins, "T", num_bins, f"the sensor's {sensor.num_bins} bins")
    frequencies = check_frequencies(_frequencies(cloud), num_bins)
    for name, count, wanted in (("height", cloud.height, sensor.rows), ("width", cloud.width, sensor.cols)):
        require(count == wanted, name, count, f"the sensor's {wanted}")
    names = [f"k{k}" for k in frequencies]
    is_int16 = any(field.name == names[0] and field.datatype == CODES[NUMBERS["int16"]] for field in cloud.fields)
    gated = any(field.name == "before" for field in cloud.fields)
    points = unpack_cloud(cloud, [_point(names, "int16" if is_int16 else "float32", gated)])
    photons, parts = points["photons"].astype(np.uint32), np.array(_parts(points, names), np.float32, order="C")
    if is_int16:
        parts /= INT16_SCALE
    _check_means(parts.view(np.complex64))
    parts *= photons[..., None].astype(np.float32)
    cycles = int(_named(cloud, CYCLES, "cycles", "0"))
    before = points["before"].astype(np.uint32) if gated else None
    return PhaseSums(frequencies, parts.view(np.complex64), photons, cloud.header.stamp_ns, cycles, before,
                     sensor=sensor)


def decode_counts_cdr(raw: bytes) -> tuple[cdr.Header, tuple[int, ...], np.ndarray]:
    """Header, frequencies and photon counts, uint32 [rows, cols], of a message; its means are not read.

    Raises:
        InvalidInput: the message has no photon counts.
    """
    cloud = cdr.CloudMessage.read(raw)
    return cloud.header, _frequencies(cloud), unpack_cloud(cloud, [COUNTS])["photons"]


def is_sketch(cloud: cdr.CloudMessage) -> bool:
    """Whether a cloud has the fields of a sketch."""
    return any(DESCRIPTION.fullmatch(field.name) for field in cloud.fields)


def _named(cloud: cdr.CloudMessage, pattern: re.Pattern, field: str, absent: str = "") -> str:
    """The group in the name of the only field that matches the pattern; `absent`, unless it is empty, if none does."""
    found = [match[1] for field in cloud.fields if (match := pattern.fullmatch(field.name))]
    if not found and absent:
        return absent
    require(len(found) == 1, f"field {field}", " and ".join(found) or "absent", "one field that names it")
    return found[0]


def _point(names: list[str], layout: str, gated: bool) -> np.dtype:
    """The numbers of a pixel, with the fields of these frequencies."""
    before = [("before", "<u4")] if gated else []
    return np.dtype([*COUNTS.descr, *((name, NUMBERS[layout], 2) for name in names), *before])


def _frequencies(cloud: cdr.CloudMessage) -> tuple[int, ...]:
    """The frequencies in the field names, unchecked."""
    return tuple(int(match[1]) for field in cloud.fields if (match := FREQUENCY.fullmatch(field.name)))


def _parts(points: np.ndarray, names: list[str]) -> np.ndarray:
    """The two numbers of each of these fields, [rows, cols, 2m]; a view if the fields lie side by side."""
    fields = fields_of(points.dtype)
    offsets, pair = [fields[name][1] for name in names], fields[names[0]][0]
    if offsets == [offsets[0] + l * pair.itemsize for l in range(len(names))]:
        block = np.dtype({"names": ["z"], "formats": [(pair.base, 2 * len(names))], "offsets": offsets[:1],
                          "itemsize": points.dtype.itemsize})
        return points.view(block)["z"]
    return np.concatenate([points[name] for name in names], axis=2)


def _check_means(means: np.ndarray) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        longest = float(np.abs(means).max(initial=0))       # a NaN makes it NaN
    require(longest <= MAX_MODULUS, "sketch", longest, "means of unit vectors, |z| ≤ 1, everywhere")
