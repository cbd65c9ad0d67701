"""PointCloud2, Image and String ⇄ bytes: the plain CDR of DDS and of bags (OMG DDS-XTypes 1.3, 7.4).

Little-endian only, as ROS 2 supports no other machines. Reading copies nothing: `data` is a view of the message. Every
length is compared with the available bytes before it is used. Numbers are aligned to their size, from the end of the
4-byte CDR header.
"""

import struct
from dataclasses import dataclass
from functools import partial
from typing import Any, NewType, Self, TypeVar

from srt3d_ros.errors import InvalidInput, require

CDR_HEADER, CDR_HEADER_BYTES = b"\x00\x01", 4        # plain CDR, little-endian; followed by 2 bytes of options
MAX_FIELDS = 256                # per point: more than any real cloud has, and still read at once
MAX_FRAME_ID = 255              # characters; every message repeats them
MAX_TRAILING_BYTES = 3          # some middleware pads messages to a multiple of 4
NS_PER_S = 1_000_000_000
T = TypeVar("T")
# Types of members beside int (uint32), bool, str and memoryview (uint8[]).
Byte = NewType("Byte", int)
Stamp = NewType("Stamp", int)   # builtin_interfaces/Time in nanoseconds


class Message:
    """A message: a dataclass whose members have the types and the order of its definition in ROS."""

    @classmethod
    def read(cls, raw: bytes) -> Self:
        """Read a serialised message; InvalidInput names the first member that is cut off or impossible."""
        reader = Reader(raw)
        message = reader.members(cls)
        reader.end()
        return message

    def write(self) -> bytes:
        """Serialise the message, ready to publish."""
        return _serialised(type(self), self)


@dataclass(frozen=True)
class Header:
    """std_msgs/Header with the stamp as one number.

    Args:
        stamp_ns: start of acquisition, nanoseconds of the sensor's clock; the seconds must fit 32 bits.
        frame_id: the tf frame of the content.
    """

    stamp_ns: Stamp
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
    datatype: Byte
    count: int


@dataclass(frozen=True, slots=True)
class CloudMessage(Message):
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
class Image(Message):
    """sensor_msgs/Image."""

    header: Header
    height: int
    width: int
    encoding: str
    is_bigendian: bool
    step: int
    data: memoryview


def read_text(raw: bytes) -> str:
    """Read a serialised std_msgs/String; InvalidInput if it is cut off or no text."""
    reader = Reader(raw)
    text = reader.text("data", len(raw))
    reader.end()
    return text


def write_text(text: str) -> bytes:
    """Serialise a std_msgs/String, ready to publish."""
    return _serialised(str, text)


def restamp(raw: bytes, stamp_ns: int) -> bytes:
    """A copy of a serialised message with another stamp, many times cheaper than serialising its data again."""
    check_stamp(stamp_ns)
    stamp = _stamp(stamp_ns)        # comes first in every message with a header
    return b"".join((raw[:CDR_HEADER_BYTES], stamp, memoryview(raw)[CDR_HEADER_BYTES + len(stamp):]))


def _stamp(stamp_ns: int) -> bytes:
    return struct.pack("<iI", *divmod(stamp_ns, NS_PER_S))


class Reader:
    """Reads a serialised message from its beginning on; InvalidInput names what is cut off or impossible."""

    def __init__(self, raw: bytes):
        self.raw = memoryview(raw)
        require(self.raw[:2] == CDR_HEADER and len(self.raw) >= CDR_HEADER_BYTES, "CDR header",
                bytes(self.raw[:4]).hex(" "), "00 01 (little-endian), then 2 bytes")
        self.at = CDR_HEADER_BYTES

    def members(self, kind: type[T], prefix: str = "") -> T:
        """An object of a dataclass; `prefix` stands in front of the names of its members in errors."""
        values = []
        for name, member in kind.__annotations__.items():
            read = READ.get(member)
            values.append(read(self, prefix + name) if read else self.members(member, f"{prefix}{name}."))
        return kind(*values)

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

    def stamp(self, field: str) -> int:
        sec, nanosec = self.number(f"{field}.sec", "i"), self.number(f"{field}.nanosec")
        require(nanosec < NS_PER_S, f"{field}.nanosec", nanosec, f"0 to {NS_PER_S - 1}")
        return sec * NS_PER_S + nanosec

    def fields(self, field: str) -> tuple[Field, ...]:
        count = self.number(field)
        require(count <= MAX_FIELDS, field, f"a sequence of {count}", f"at most {MAX_FIELDS} fields")
        return tuple(self.members(Field, f"{field}.") for _ in range(count))

    def end(self) -> None:
        left = len(self.raw) - self.at
        require(left <= MAX_TRAILING_BYTES, "message", f"{left} bytes too long", f"{self.at} bytes")


READ = {int: Reader.number, Byte: partial(Reader.number, code="B"), bool: Reader.flag, str: Reader.text,
        memoryview: Reader.sequence, Stamp: lambda reader, name: reader.stamp("header.stamp"),
        tuple[Field, ...]: Reader.fields}


def _serialised(kind: Any, value: Any) -> bytes:
    """The bytes of a value of the type `kind`."""
    parts: list[bytes | memoryview] = [CDR_HEADER + bytes(2)]
    size = 0

    def append(raw: bytes | memoryview) -> None:
        nonlocal size
        parts.append(raw)
        size += len(raw)

    def append_value(kind: Any, value: Any) -> None:
        if kind is int:
            append(bytes(-size % 4) + struct.pack("<I", value))
        elif kind in (Byte, bool):
            append(bytes([value]))
        elif kind in (str, memoryview):
            raw = value.encode() + b"\0" if kind is str else value
            append_value(int, len(raw))
            append(raw)
        elif kind is Stamp:         # comes first
            append(_stamp(value))
        elif kind == tuple[Field, ...]:
            append_value(int, len(value))
            for one in value:
                append_value(Field, one)
        else:
            for name, member in kind.__annotations__.items():
                append_value(member, getattr(value, name))

    append_value(kind, value)
    return b"".join(parts)
