"""PointCloud2 and Image as objects: the message classes of rclpy. What rosbags deserialises reads the same way.

The classes are imported where one is made: what is serialised, a bag, is read without ROS.
"""

import array
from typing import TYPE_CHECKING

from srt3d_ros.errors import require
from srt3d_ros.messages.cdr import Cloud, Field, Image
from srt3d_ros.messages.header import Header

if TYPE_CHECKING:
    from sensor_msgs.msg import Image as ImageMessage
    from sensor_msgs.msg import PointCloud2
    from std_msgs.msg import Header as HeaderMessage


def to_header_message(header: Header) -> "HeaderMessage":
    """The std_msgs/Header."""
    from builtin_interfaces.msg import Time
    from std_msgs.msg import Header as HeaderMessage

    return HeaderMessage(stamp=Time(sec=header.sec, nanosec=header.nanosec), frame_id=header.frame_id)


def from_header_message(message: "HeaderMessage") -> Header:
    """The content of a std_msgs/Header; InvalidInput if its stamp is no time."""
    return Header.of(message.stamp.sec, message.stamp.nanosec, message.frame_id)


def to_cloud_message(cloud: Cloud) -> "PointCloud2":
    """The PointCloud2, with its own copy of the data."""
    from sensor_msgs.msg import PointCloud2, PointField

    fields = [PointField(name=field.name, offset=field.offset, datatype=field.datatype, count=field.count)
              for field in cloud.fields]
    message = PointCloud2(header=to_header_message(cloud.header), height=cloud.height, width=cloud.width, fields=fields,
                          is_bigendian=cloud.is_bigendian, point_step=cloud.point_step, row_step=cloud.row_step,
                          is_dense=cloud.is_dense)
    message.data = _bytes(cloud.data)
    return message


def from_cloud_message(message: "PointCloud2") -> Cloud:
    """The content of a PointCloud2, without a copy of the data."""
    fields = tuple(Field(field.name, field.offset, field.datatype, field.count) for field in message.fields)
    return Cloud(from_header_message(message.header), message.height, message.width, fields, message.is_bigendian,
                 message.point_step, message.row_step, memoryview(message.data), message.is_dense)


def to_image_message(image: Image) -> "ImageMessage":
    """The Image, with its own copy of the data."""
    from sensor_msgs.msg import Image as ImageMessage

    message = ImageMessage(header=to_header_message(image.header), height=image.height, width=image.width,
                           encoding=image.encoding, is_bigendian=int(image.is_bigendian), step=image.step)
    message.data = _bytes(image.data)
    return message


def from_image_message(message: "ImageMessage") -> Image:
    """The content of an Image, without a copy of the data."""
    require(message.is_bigendian in (0, 1), "is_bigendian", message.is_bigendian, "0 or 1")
    return Image(from_header_message(message.header), message.height, message.width, message.encoding,
                 bool(message.is_bigendian), message.step, memoryview(message.data))


def _bytes(data: memoryview) -> array.array:
    """The one type that a `uint8[]` field takes fast: an ndarray is copied number by number, 40 ns a byte."""
    out = array.array("B")
    out.frombytes(data)
    return out
