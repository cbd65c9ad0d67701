"""QoS of the pipeline's topics, and the parameters `qos_overrides.…` with which a user changes it."""

from collections.abc import Iterable, Iterator

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from srt3d_ros.nodes.parameters import Parameter

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
OVERRIDABLE = QoSOverridingOptions(
    (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY))
MAX_DEPTH = 100_000
POLICIES = {"history": HistoryPolicy, "reliability": ReliabilityPolicy, "durability": DurabilityPolicy}


def overrides(subscribed: Iterable[str], published: Iterable[str]) -> Iterator[Parameter]:
    """The overrides of topics by their final names. rclpy declares them where it makes the topics, and checks none."""
    for entity, topics in (("subscription", subscribed), ("publisher", published)):
        for topic in topics:
            begin = f"qos_overrides.{topic}.{entity}."
            yield Parameter(f"{begin}depth", 1, "Messages that may wait.", low=1, high=MAX_DEPTH)
            for policy, values in POLICIES.items():
                choices = tuple(value.name.lower() for value in values if value.name != "UNKNOWN")
                yield Parameter(f"{begin}{policy}", "system_default", f"The {policy} policy.", choices=choices)
