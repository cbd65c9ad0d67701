"""PointCloud2 ⇄ structured array, and Image ⇄ array: the layout of the numbers in `data`."""

from collections.abc import Collection, Iterable

import numpy as np

from srt3d_ros.errors import require
from srt3d_ros.messages.cdr import Byte, CloudMessage, Field, Header, Image, Stamp
from srt3d_ros.messages.schema_files import DATATYPES, encodings, fields_of

NAMES, STORED = dict(enumerate(DATATYPES, 1)), dict(enumerate(DATATYPES.values(), 1))      # by code in messages
CODES = {stored: Byte(code) for code, stored in STORED.items()}
MAX_POINT_STEP = 65_535         # bytes; the largest sketch needs 516


def encode_cloud(points: np.ndarray, stamp_ns: int, frame_id: str, is_dense: bool = True,
                 further: Iterable[Field] = ()) -> bytes:
    """The serialised cloud of a structured array of points, [N] or [rows, cols]: its fields, and `further` ones."""
    height, width = points.shape if points.ndim == 2 else (1, len(points))
    fields = tuple(Field(name, offset, *_wire_type(kind)) for name, (kind, offset) in fields_of(points.dtype).items())
    step = points.dtype.itemsize
    return CloudMessage(Header(Stamp(stamp_ns), frame_id), height, width, (*fields, *further), False, step,
                        width * step, _bytes(points), is_dense).write()


def unpack_cloud(cloud: CloudMessage, layouts: Collection[np.dtype]) -> np.ndarray:
    """The points of a cloud as a structured array [height, width], a view of its bytes.

    Fields may have any order, offset and byte order, with gaps and other fields between them.

    Args:
        cloud: any cloud.
        layouts: accepted layouts, with the same field names; each field must have its type in one of them.

    Raises:
        InvalidInput: a field is missing, repeated or of another type, or the sizes contradict each other.
    """
    chosen = {name: _find(cloud, name, {_wire_type(layout[name]) for layout in layouts})
              for name in fields_of(next(iter(layouts)))}
    end = 0
    for field in sorted(chosen.values(), key=lambda field: field.offset):
        require(field.offset >= end, f"{field.name} offset", field.offset, f"{end} or more, behind the field before it")
        end = field.offset + _stored(field).itemsize
        require(end <= cloud.point_step, f"{field.name} offset", field.offset,
                f"the field to end within point_step = {cloud.point_step}, not at {end}")
    require(cloud.point_step <= MAX_POINT_STEP, "point_step", cloud.point_step, f"at most {MAX_POINT_STEP} bytes")
    _check_sizes(cloud.height, cloud.width * cloud.point_step, "row_step", cloud.row_step, len(cloud.data))
    point = np.dtype({"names": list(chosen), "formats": [_stored(field) for field in chosen.values()],
                      "offsets": [field.offset for field in chosen.values()], "itemsize": cloud.point_step})
    point = point.newbyteorder(">" if cloud.is_bigendian else "<")
    return np.ndarray((cloud.height, cloud.width), point, cloud.data, strides=(cloud.row_step, cloud.point_step))


def encode_image(pixels: np.ndarray, name: str, stamp_ns: int, frame_id: str) -> bytes:
    """The serialised image of an array [height, width, channels], as the schema `name` encodes its dtype."""
    height, width, channels = pixels.shape
    stored = pixels.dtype.newbyteorder("<")
    encoding, = (encoding for encoding, kind in encodings(name, channels).items() if kind == stored)
    return Image(Header(Stamp(stamp_ns), frame_id), height, width, encoding, False,
                 width * channels * stored.itemsize, _bytes(pixels.astype(stored, copy=False))).write()


def unpack_image(image: Image, name: str, channels: int = 1) -> np.ndarray:
    """The numbers of an image of the schema `name`, [height, width, channels], a view of its bytes.

    Raises:
        InvalidInput: the image has another encoding or number of channels, or the sizes contradict each other.
    """
    kinds = encodings(name, channels)
    require(image.encoding in kinds, "encoding", image.encoding, " or ".join(kinds))
    kind = kinds[image.encoding].newbyteorder(">" if image.is_bigendian else "<")
    pixel_bytes = channels * kind.itemsize
    # Rows of a wider type would otherwise be read as padded rows.
    for other, wider in kinds.items():
        require(wider.itemsize == kind.itemsize or image.step != image.width * channels * wider.itemsize, "encoding",
                image.encoding, f"{other}, as a row has {image.step} bytes")
    _check_sizes(image.height, image.width * pixel_bytes, "step", image.step, len(image.data))
    return np.ndarray((image.height, image.width, channels), kind, image.data,
                      strides=(image.step, pixel_bytes, kind.itemsize))


def _find(cloud: CloudMessage, name: str, types: set[tuple[int, int]]) -> Field:
    found = [field for field in cloud.fields if field.name == name]
    kinds = " or ".join(sorted(NAMES[code] for code, _ in types))
    require(len(found) == 1, f"field {name}", f"there {len(found)} times" if found else "absent",
            f"one field of type {kinds}")
    field, = found
    require(any(field.datatype == code for code, _ in types), f"{name} datatype",
            NAMES.get(field.datatype, field.datatype), kinds)
    require((field.datatype, field.count) in types, f"{name} count", field.count,
            " or ".join(sorted({str(count) for _, count in types})))
    return field


def _check_sizes(height: int, row_bytes: int, step_name: str, step: int, data_bytes: int) -> None:
    require(step >= row_bytes, step_name, step, f"{row_bytes} bytes or more, one row")
    require(height * step == data_bytes, "data", f"{data_bytes} bytes",
            f"height × {step_name} = {height} × {step} = {height * step} bytes")


def _stored(field: Field) -> np.dtype:
    return np.dtype((STORED[field.datatype], (field.count,) if field.count > 1 else ()))


def _wire_type(kind: np.dtype) -> tuple[Byte, int]:
    """The datatype code and the count of a PointField for a dtype."""
    return CODES[kind.base], int(np.prod(kind.shape))


def _bytes(numbers: np.ndarray) -> memoryview:
    return np.ascontiguousarray(numbers).reshape(-1).view(np.uint8).data
