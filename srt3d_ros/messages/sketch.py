"""`sketch`: Sketch ⇄ PointCloud2 (msg_schemas/sketch.json), whose fields name frequencies, T and sensor."""

import re
from dataclasses import replace

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sketch import Sketch, check_frequencies
from srt3d_ros.errors import require
from srt3d_ros.messages import cdr, coded_sketch
from srt3d_ros.messages.packing import CODES, pack_cloud, unpack_cloud
from srt3d_ros.messages.sensor import digest

INT16_SCALE = 32_767
NUMBERS = {"float32": np.dtype("<f4"), "int16": np.dtype("<i2")}      # of the layouts that are not coded
COUNTS = np.dtype([("photons", "<u4")])
CODED = np.dtype([("coded", "u1")])
FREQUENCY, PERIOD, DESCRIPTION = map(re.compile, (r"k([1-9]\d{0,4})", r"T([1-9]\d{0,4})", r"sensor_([0-9a-f]{8})"))
MAX_MODULUS = 1.001     # a mean of unit vectors is at most 1 long; the rest is for rounding


def encode_cdr(sketch: Sketch, sensor: SensorModel, frame_id: str, layout: str = "float32") -> bytes:
    """The serialised message of a sketch.

    Args:
        sketch: of one frame or window.
        sensor: of its photons, as described on `sketch/sensor`.
        frame_id: the sensor's tf frame.
        layout: "float32"; "int16" for half the bytes, or "coded" for a tenth.

    Raises:
        InvalidInput: the sketch is not one of photons: a mean longer than 1, or not a number.
    """
    header, names = cdr.Header(sketch.stamp_ns, frame_id), [f"k{k}" for k in sketch.frequencies]
    markers = [f"T{sensor.num_bins}", f"sensor_{digest(sensor)}"]
    if layout == "coded":
        cloud = pack_cloud(header, np.frombuffer(coded_sketch.encode(sketch), CODED))
        fields, markers = cloud.fields, names + markers
    else:
        number = NUMBERS[layout]
        points = np.zeros(sketch.photons.shape, [*COUNTS.descr, ("z", number, 2 * len(names))])
        points["photons"] = sketch.photons
        means = np.ascontiguousarray(sketch.z, np.complex64)
        _check_means(means)
        parts = means.view(np.float32)
        points["z"] = np.rint(parts * INT16_SCALE) if layout == "int16" else parts
        cloud = pack_cloud(header, points)
        fields = (cloud.fields[0], *(cdr.Field(name, COUNTS.itemsize + 2 * l * number.itemsize, CODES[number], 2)
                                     for l, name in enumerate(names)))
    markers = tuple(cdr.Field(name, 0, CODES[np.dtype("u1")], 1) for name in markers)
    return cdr.write_cloud(replace(cloud, fields=fields + markers))


def description_cdr(raw: bytes) -> str:
    """The digest (messages.sensor.digest) of the description that a serialised message belongs to.

    Raises:
        InvalidInput: the message names none.
    """
    return _named(cdr.read_cloud(raw), DESCRIPTION, "sensor_DIGEST")


def decode_cdr(raw: bytes, sensor: SensorModel) -> tuple[cdr.Header, Sketch]:
    """The sketch of a serialised message in any layout.

    Args:
        raw: from `sketch`.
        sensor: of the description that it belongs to.

    Raises:
        InvalidInput: the message does not keep the schema or fit the sensor.
    """
    cloud = cdr.read_cloud(raw)
    num_bins = int(_named(cloud, PERIOD, "T"))
    require(num_bins == sensor.num_bins, "T", num_bins, f"the sensor's {sensor.num_bins} bins")
    frequencies = check_frequencies(_frequencies(cloud), num_bins)
    added_variance = 0.0
    if (coded := _coded(cloud)) is not None:
        photons, sums, added_variance = coded_sketch.decode(coded, frequencies, (sensor.rows, sensor.cols))
    else:
        for name, count, wanted in (("height", cloud.height, sensor.rows), ("width", cloud.width, sensor.cols)):
            require(count == wanted, name, count, f"the sensor's {wanted}")
        names = [f"k{k}" for k in frequencies]
        is_int16 = any(field.name == names[0] and field.datatype == CODES[NUMBERS["int16"]] for field in cloud.fields)
        number = NUMBERS["int16" if is_int16 else "float32"]
        points = unpack_cloud(cloud, [np.dtype([*COUNTS.descr, *((name, number, 2) for name in names)])])
        photons, parts = points["photons"].astype(np.uint32), np.array(_parts(points, names), np.float32, order="C")
        if is_int16:
            parts /= INT16_SCALE
        _check_means(parts.view(np.complex64))
        parts *= photons[..., None].astype(np.float32)
        sums = parts.view(np.complex64)
    return cloud.header, Sketch(frequencies, sums, photons, cloud.header.stamp_ns, added_variance, sensor)


def decode_counts_cdr(raw: bytes) -> tuple[cdr.Header, tuple[int, ...], np.ndarray]:
    """Header, frequencies, and the photons of each pixel, uint32 [rows, cols], of a message, whose means are not read.

    Raises:
        InvalidInput: the message is no cloud with photon counts.
    """
    cloud = cdr.read_cloud(raw)
    coded = _coded(cloud)
    counts = unpack_cloud(cloud, [COUNTS])["photons"] if coded is None else coded_sketch.decode_counts(coded)
    return cloud.header, _frequencies(cloud), counts


def is_sketch(cloud: cdr.Cloud) -> bool:
    """Whether a cloud is a sketch, by its fields."""
    return any(DESCRIPTION.fullmatch(field.name) for field in cloud.fields)


def _named(cloud: cdr.Cloud, pattern: re.Pattern, field: str) -> str:
    """What the only field of this pattern says."""
    found = [match[1] for field in cloud.fields if (match := pattern.fullmatch(field.name))]
    require(len(found) == 1, f"field {field}", " and ".join(found) or "absent", "one field that names it")
    return found[0]


def _frequencies(cloud: cdr.Cloud) -> tuple[int, ...]:
    """The frequencies that the fields name, unchecked."""
    return tuple(int(match[1]) for field in cloud.fields if (match := FREQUENCY.fullmatch(field.name)))


def _coded(cloud: cdr.Cloud) -> bytes | None:
    """The bytes of a sketch in the layout coded; None if it is another."""
    if all(field.name != "coded" for field in cloud.fields):
        return None
    require(cloud.height == 1, "height", cloud.height, "1 with the field coded")
    return unpack_cloud(cloud, [CODED]).tobytes()


def _parts(points: np.ndarray, names: list[str]) -> np.ndarray:
    """The two numbers of each of these fields, [rows, cols, 2m]; a view where they lie side by side."""
    offsets, pair = [points.dtype.fields[name][1] for name in names], points.dtype[names[0]]
    if offsets == [offsets[0] + l * pair.itemsize for l in range(len(names))]:
        block = {"names": ["z"], "formats": [(pair.base, 2 * len(names))], "offsets": offsets[:1],
                 "itemsize": points.dtype.itemsize}
        return points.view(block)["z"]
    return np.concatenate([points[name] for name in names], axis=2)


def _check_means(means: np.ndarray) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        longest = float(np.abs(means).max(initial=0))       # a NaN makes it NaN
    require(longest <= MAX_MODULUS, "sketch", longest, "means of unit vectors, |z| ≤ 1, everywhere")
