"""Header: when and where a message's content was measured."""

from dataclasses import dataclass

from srt3d_ros.errors import InvalidInput, require

NS_PER_S = 1_000_000_000


@dataclass(frozen=True)
class Header:
    """std_msgs/Header with the stamp as one number.

    Args:
        stamp_ns: start of acquisition, nanoseconds of the sensor's clock; its seconds must fit 32 bits.
        frame_id: the tf frame of the content.
    """

    stamp_ns: int
    frame_id: str

    def __post_init__(self):
        require(-(2**31) <= self.sec < 2**31, "header.stamp", self.stamp_ns, "nanoseconds whose seconds fit 32 bits")
        check_frame_id("header.frame_id", self.frame_id)

    @classmethod
    def of(cls, sec: int, nanosec: int, frame_id: str) -> "Header":
        """From the parts of a builtin_interfaces/Time; InvalidInput if they are not a time."""
        require(0 <= nanosec < NS_PER_S, "header.stamp.nanosec", nanosec, f"0 to {NS_PER_S - 1}")
        return cls(sec * NS_PER_S + nanosec, frame_id)

    @property
    def sec(self) -> int:
        """Whole seconds of the stamp, rounded down."""
        return self.stamp_ns // NS_PER_S

    @property
    def nanosec(self) -> int:
        """Nanoseconds of the stamp above `sec`."""
        return self.stamp_ns % NS_PER_S


def check_frame_id(field: str, frame_id: str) -> None:
    """Raise InvalidInput unless a ROS string can carry `frame_id`."""
    try:
        frame_id.encode()
    except UnicodeEncodeError:
        raise InvalidInput(field, ascii(frame_id), "text that UTF-8 can carry") from None
    require("\0" not in frame_id, field, frame_id, "text without NUL characters")
