"""PointCloud2, Image and String ⇄ bytes: the plain CDR of DDS and of bags (OMG DDS-XTypes 1.3, 7.4).

Little-endian only, as ROS 2 supports no other machines. Reading copies nothing: `data` is a view of the message. Every
length is compared with the available bytes before it is used. Numbers are aligned to their size, from the end of the
4-byte CDR header.
"""

import struct
from dataclasses import dataclass

from srt3d_ros.errors import InvalidInput, require

CDR_HEADER, CDR_HEADER_BYTES = b"\x00\x01", 4        # plain CDR, little-endian; followed by 2 bytes of options
MAX_FIELDS = 256                # per point: more than any real cloud has, and still read at once
MAX_FRAME_ID = 255              # characters; every message repeats them
MAX_TRAILING_BYTES = 3          # some middleware pads messages to a multiple of 4
NS_PER_S = 1_000_000_000


@dataclass(frozen=True)
class Header:
    """std_msgs/Header with the stamp as one number.

    Args:
        stamp_ns: start of acquisition, nanoseconds of the sensor's clock; the seconds must fit 32 bits.
        frame_id: the tf frame of the content.
    """

    stamp_ns: int
    frame_id: str

    def __post_init__(self):
        check_stamp(self.stamp_ns)
        check_frame_id("header.frame_id", self.frame_id)


def check_stamp(stamp_ns: int) -> None:
    """Raise InvalidInput unless the stamp fits a ROS header."""
    require(-(2**31) <= stamp_ns // NS_PER_S < 2**31, "header.stamp", stamp_ns,
            "nanoseconds whose seconds fit 32 bits")


def check_frame_id(field: str, frame_id: str) -> None:
    """Raise InvalidInput unless `frame_id` fits a ROS string and is short enough for every message."""
    require(len(frame_id) <= MAX_FRAME_ID, field, f"{len(frame_id)} characters", f"at most {MAX_FRAME_ID}")
    try:
        frame_id.encode()
    except UnicodeEncodeError:
        raise InvalidInput(field, ascii(frame_id), "text that can be encoded in UTF-8") from None
    require("\0" not in frame_id, field, frame_id, "text without NUL characters")


@dataclass(frozen=True, slots=True)
class Field:
    """sensor_msgs/PointField."""

    name: str
    offset: int
    datatype: int
    count: int


@dataclass(frozen=True, slots=True)
class CloudMessage:
    """sensor_msgs/PointCloud2."""

    header: Header
    height: int
    width: int
    fields: tuple[Field, ...]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: memoryview
    is_dense: bool


@dataclass(frozen=True, slots=True)
class Image:
    """sensor_msgs/Image."""

    header: Header
    height: int
    width: int
    encoding: str
    is_bigendian: bool
    step: int
    data: memoryview


def read_cloud(raw: bytes) -> CloudMessage:
    """Read a serialised PointCloud2; InvalidInput names the first field that is cut off or impossible."""
    reader = Reader(raw)
    header, height, width = reader.header(), reader.number("height"), reader.number("width")
    count = reader.number("fields")
    require(count <= MAX_FIELDS, "fields", f"a sequence of {count}", f"at most {MAX_FIELDS} fields")
    fields = tuple(Field(reader.text("fields.name"), reader.number("fields.offset"),
                         reader.number("fields.datatype", "B"), reader.number("fields.count")) for _ in range(count))
    cloud = CloudMessage(header, height, width, fields, reader.flag("is_bigendian"), reader.number("point_step"),
                  reader.number("row_step"), reader.sequence("data"), reader.flag("is_dense"))
    reader.end()
    return cloud


def write_cloud(cloud: CloudMessage) -> bytes:
    """Serialise a PointCloud2, ready to publish."""
    writer = _Writer()
    writer.header(cloud.header)
    writer.numbers("I", cloud.height, cloud.width, len(cloud.fields))
    for field in cloud.fields:
        writer.text(field.name)
        writer.numbers("I", field.offset)
        writer.numbers("B", field.datatype)
        writer.numbers("I", field.count)
    writer.numbers("B", cloud.is_bigendian)
    writer.numbers("I", cloud.point_step, cloud.row_step)
    return writer.finish(cloud.data, bytes([cloud.is_dense]))


def read_text(raw: bytes) -> str:
    """Read a serialised std_msgs/String; InvalidInput if it is cut off or no text."""
    reader = Reader(raw)
    text = reader.text("data", len(raw))
    reader.end()
    return text


def write_text(text: str) -> bytes:
    """Serialise a std_msgs/String, ready to publish."""
    writer = _Writer()
    writer.text(text)
    return bytes(writer.raw)


def restamp(raw: bytes, stamp_ns: int) -> bytes:
    """A copy of a serialised message with another stamp, many times cheaper than serialising its data again."""
    check_stamp(stamp_ns)
    stamp = _stamp(stamp_ns)        # comes first in every message with a header
    return b"".join((raw[:CDR_HEADER_BYTES], stamp, memoryview(raw)[CDR_HEADER_BYTES + len(stamp):]))


def _stamp(stamp_ns: int) -> bytes:
    return struct.pack("<iI", *divmod(stamp_ns, NS_PER_S))


def read_image(raw: bytes) -> Image:
    """Read a serialised Image; InvalidInput names the first field that is cut off or impossible."""
    reader = Reader(raw)
    image = Image(reader.header(), reader.number("height"), reader.number("width"), reader.text("encoding"),
                  reader.flag("is_bigendian"), reader.number("step"), reader.sequence("data"))
    reader.end()
    return image


def write_image(image: Image) -> bytes:
    """Serialise an Image, ready to publish."""
    writer = _Writer()
    writer.header(image.header)
    writer.numbers("I", image.height, image.width)
    writer.text(image.encoding)
    writer.numbers("B", image.is_bigendian)
    writer.numbers("I", image.step)
    return writer.finish(image.data)


class Reader:
    """Reads the fields of a serialised message in order; InvalidInput names the field that is cut off or impossible."""

    def __init__(self, raw: bytes):
        self.raw = memoryview(raw)
        require(self.raw[:2] == CDR_HEADER and len(self.raw) >= CDR_HEADER_BYTES, "CDR header",
                bytes(self.raw[:4]).hex(" "), "00 01 (little-endian), then 2 bytes")
        self.at = CDR_HEADER_BYTES

    def take(self, field: str, count: int) -> memoryview:
        """The next `count` bytes."""
        left = len(self.raw) - self.at
        require(count <= left, field, f"cut off at byte {len(self.raw)}", f"{count} bytes from byte {self.at} on")
        self.at += count
        return self.raw[self.at - count:self.at]

    def number(self, field: str, code: str = "I") -> int:
        """An integer of the `struct` type `code`."""
        return self.numbers(field, 1, code)[0]

    def numbers(self, field: str, count: int, code: str = "d") -> tuple:
        """`count` numbers of the `struct` type `code`."""
        size = struct.calcsize(code)
        self.at += -(self.at - CDR_HEADER_BYTES) % size
        return struct.unpack(f"<{count}{code}", self.take(field, count * size))

    def flag(self, field: str) -> bool:
        value = self.number(field, "B")
        require(value in (0, 1), field, value, "0 or 1")
        return bool(value)

    def sequence(self, field: str) -> memoryview:
        """A sequence of bytes, or the bytes of a string."""
        return self.take(field, self.number(field))

    def text(self, field: str, most: int = 4 * MAX_FRAME_ID + 1) -> str:
        raw = bytes(self.sequence(field))
        require(len(raw) <= most, field, f"{len(raw)} bytes", f"at most {most}")
        require(not raw or raw[-1] == 0, field, raw, "a string that ends with a NUL")
        try:
            return raw[:-1].decode()
        except UnicodeDecodeError:
            raise InvalidInput(field, raw, "a string in UTF-8") from None

    def header(self) -> Header:
        sec, nanosec = self.number("header.stamp.sec", "i"), self.number("header.stamp.nanosec")
        require(nanosec < NS_PER_S, "header.stamp.nanosec", nanosec, f"0 to {NS_PER_S - 1}")
        return Header(sec * NS_PER_S + nanosec, self.text("header.frame_id"))

    def end(self) -> None:
        left = len(self.raw) - self.at
        require(left <= MAX_TRAILING_BYTES, "message", f"{left} bytes too long", f"{self.at} bytes")


class _Writer:
    def __init__(self):
        self.raw = bytearray(b"\x00\x01\x00\x00")

    def header(self, header: Header) -> None:
        self.raw += _stamp(header.stamp_ns)
        self.text(header.frame_id)

    def numbers(self, code: str, *values: int) -> None:
        """Append integers of the `struct` type `code`."""
        self.raw += bytes(-(len(self.raw) - CDR_HEADER_BYTES) % struct.calcsize(code))
        self.raw += struct.pack(f"<{len(values)}{code}", *values)

    def text(self, value: str) -> None:
        encoded = value.encode() + b"\0"
        self.numbers("I", len(encoded))
        self.raw += encoded

    def finish(self, data: memoryview, tail: bytes = b"") -> bytes:
        self.numbers("I", len(data))
        return b"".join((self.raw, data, tail))
