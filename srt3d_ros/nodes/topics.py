"""The topics of the pipeline and their QoS. msg_schemas/ has the layouts of their messages."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib import import_module

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Log, ParameterEvent
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import CameraInfo, Image, Imu, PointCloud2
from std_msgs.msg import String

from srt3d_ros.nodes.parameters import Parameter

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
OVERRIDABLE = QoSOverridingOptions(
    (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY))
MAX_DEPTH = 100_000
POLICIES = {"history": HistoryPolicy, "reliability": ReliabilityPolicy, "durability": DurabilityPolicy}


@dataclass(frozen=True)
class Topic:
    """A topic that a node subscribes to or publishes.

    Args:
        name: relative, so that namespaces and remappings apply.
        type: its name if its package need not be installed.
        about: what is in it, in a few words.
        latched: reliable and transient local: a late subscriber still gets the last message.
        when: the condition under which it exists; always if empty.
    """

    name: str
    type: type | str
    about: str
    latched: bool = False
    when: str = ""

    @property
    def type_name(self) -> str:
        """As `ros2 topic list -t` writes it."""
        if isinstance(self.type, str):
            return self.type
        return f"{self.type.__module__.split('.')[0]}/msg/{self.type.__name__}"

    def load(self) -> type:
        """The class of its messages; ModuleNotFoundError if their package is not installed."""
        if not isinstance(self.type, str):
            return self.type
        package, _, name = self.type.split("/")
        return getattr(import_module(f"{package}.msg"), name)


SENSOR = Topic("sensor", String, "the sensor's description (JSON)", latched=True)
LENS = Topic("sensor/camera_info", CameraInfo, "the sensor's pinhole and lens, instead of the description's projection",
             when="a calibrated camera publishes it")
PHOTONS = Topic("photons", PointCloud2, "photons as events: row, col, time of arrival (ToA)")
GATES = Topic("gates", Image, "photons as the ToA words of a gated SPAD array")
HISTOGRAMS = Topic("histograms", Image, "photons as counts in bins, from a histogramming sensor")
FRAMES = (PHOTONS, GATES, HISTOGRAMS)       # of which a driver publishes one
ODOM = Topic("odom", Odometry, "where the robot is", when="`motion` is odom")
IMU = Topic("imu", Imu, "how fast the robot turns", when="`motion` is imu")
TF_STATIC = Topic("/tf_static", "tf2_msgs/msg/TFMessage", "where the sensor is on the robot", latched=True,
                  when="there is `motion`, and `extrinsics` is empty")
MOTION = (ODOM, IMU, TF_STATIC)
SKETCH_SENSOR = Topic("sketch/sensor", String, "sensor, frequencies and window of the sketches (JSON)", latched=True)
SKETCH = Topic("sketch", PointCloud2, "of each pixel, the number of photons and m complex numbers")
POINTS = Topic("points", PointCloud2, "the surfaces' points, metres, in the sensor's frame")
WATCHED = "while somebody subscribes"
IMAGES = (
    Topic("depth", Image, "metres to the first point (`surface_order`) of each pixel: z of a pinhole sensor, range of "
          "a scanner", when=WATCHED),
    Topic("intensity", Image, "signal photons of the first point of each pixel", when=WATCHED),
    Topic("background", Image, "background photons of each pixel", when=WATCHED),
)
CAMERA_INFO = Topic("camera_info", CameraInfo, "the camera of the images", when=f"{WATCHED}, of a pinhole sensor")
DIAGNOSTICS = Topic("/diagnostics", DiagnosticArray, "rates, latency, photons, points, drops by cause, last error")
ROSOUT = Topic("/rosout", Log, "what the nodes log")
PARAMETER_EVENTS = Topic("/parameter_events", ParameterEvent, "changes of the nodes' parameters")


def qos_overrides(subscribed: Iterable[str], published: Iterable[str]) -> Iterator[Parameter]:
    """The parameters `qos_overrides.…` of topics, by their final names. rclpy declares them and checks no value."""
    for entity, topics in (("subscription", subscribed), ("publisher", published)):
        for topic in topics:
            prefix = f"qos_overrides.{topic}.{entity}."
            yield Parameter(f"{prefix}depth", 1, "Messages that may wait.", low=1, high=MAX_DEPTH)
            for policy, values in POLICIES.items():
                choices = tuple(value.name.lower() for value in values if value.name != "UNKNOWN")
                yield Parameter(f"{prefix}{policy}", "system_default", f"The {policy} policy.", choices=choices)
