"""The topics of the pipeline with their QoS, and NodeSpec, the table of a node's interface."""

from collections.abc import Iterable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSPolicyKind
from rclpy.qos_overriding_options import QoSOverridingOptions

from srt3d_ros.core.sensor import model
from srt3d_ros.nodes.common.parameters import Parameter

OVERRIDABLE = QoSOverridingOptions(
    (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY))
TEXT, CAMERA = "std_msgs/msg/String", "sensor_msgs/msg/CameraInfo"
CLOUD, IMAGE = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Image"


@dataclass(frozen=True)
class Topic:
    """A topic that a node subscribes to or publishes.

    Args:
        name: relative, so that namespaces and remappings apply.
        type: its message type, as `ros2 topic list -t` writes it.
        about: its content, in a few words.
        latched: reliable and transient local: a late subscriber still gets the last message.
        when: the condition under which it exists; empty: always.
    """

    name: str
    type: str
    about: str
    latched: bool = False
    when: str = ""

    @property
    def durability(self) -> DurabilityPolicy:
        return DurabilityPolicy.TRANSIENT_LOCAL if self.latched else DurabilityPolicy.VOLATILE

    def load(self) -> Any:
        """The message class; ModuleNotFoundError if its package is not installed."""
        package, _, name = self.type.split("/")
        return getattr(import_module(f"{package}.msg"), name)


SENSOR = Topic("sensor", TEXT, "the sensor's description (JSON)", latched=True)
PHOTONS = Topic("photons", CLOUD, "photons as events: row, col, time of arrival (ToA)")
GATES = Topic("gates", IMAGE, "photons as the ToA words of a gated SPAD array")
HISTOGRAMS = Topic("histograms", IMAGE, "photons as counts in bins, from a histogramming sensor")
FRAMES = (PHOTONS, GATES, HISTOGRAMS)       # a driver publishes one of them
ODOM = Topic("odom", "nav_msgs/msg/Odometry", "pose and twist of the robot", when="`motion` is odom, or with windows")
IMU = Topic("imu", "sensor_msgs/msg/Imu", "angular velocity of the robot", when="`motion` is imu")
MOTION = (ODOM, IMU)
SKETCH_SENSOR = Topic("sketch/sensor", TEXT, "the sensor of the sketches, behind the gate (JSON)", latched=True)
SKETCH = Topic("sketch", CLOUD, "photon count and m complex numbers per pixel; the field names give frequencies and "
               "description")
POINTS = Topic("points", CLOUD, "points on the surfaces, metres, in the sensor's frame")
WATCHED = "while it has subscribers"
FREE = Topic("free", CLOUD, "how far pixels without a point are empty, for costmaps to clear: one point at the end of "
             "each empty ray", when=f"{WATCHED} and `free_brightness` is above 0")
IMAGE_TOPICS = (
    Topic("depth", IMAGE, "depth of each pixel's strongest point, metres: z for a pinhole sensor, range for a "
          "scanner; +Inf where it is empty to `max_range_m` or, without, the end of the "
          "period (needs `free_brightness`)", when=WATCHED),
    Topic("intensity", IMAGE, "signal photons of each pixel's strongest point", when=WATCHED),
    Topic("background", IMAGE, "background photons of each pixel", when=WATCHED),
)
CAMERA_INFO = Topic("camera_info", CAMERA, "the camera of the images", when=f"{WATCHED}, pinhole sensors only")
DIAGNOSTICS = Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray",
                    "rates, latency, photons, points, drops by cause, last error")
# All but DIAGNOSTICS, which stays outside of namespaces.
RELATIVE = {topic.name: topic for topic in (
    *FRAMES, SENSOR, *MOTION, SKETCH, SKETCH_SENSOR, POINTS, FREE, *IMAGE_TOPICS, CAMERA_INFO)}

AUTOSTART = Parameter("autostart", True, "true: configure and activate at the start. false: leave it to a manager.")
# A limit, since anyone on the network can publish a description. With the default, twice the pixels of the largest SPAD
# cameras on robots (512 × 512), a sketcher allocates at most 0.3 GB and a reconstructor 0.7 GB.
MAX_PIXELS_PARAMETER = Parameter(
    "max_pixels", 2**19, "Largest sensor, rows × cols, for which the node allocates memory. Descriptions of larger "
    "ones are refused.", low=1, high=model.MAX_PIXELS)


@dataclass(frozen=True)
class NodeSpec:
    """The public interface of a node, without what every node has.

    Args:
        name: of the node and of its executable.
    """

    name: str
    inputs: Iterable[Topic] = ()
    outputs: Iterable[Topic] = ()
    parameters: Iterable[Parameter] = ()

    @property
    def table(self) -> tuple[Parameter, ...]:
        return (*self.parameters, AUTOSTART)
