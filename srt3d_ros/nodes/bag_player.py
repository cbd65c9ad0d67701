"""`srt3d play BAG`: publish the photons or sketches of a bag, for those without `ros2 bag play`."""

import re
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from srt3d_ros.datasets.bags.bag import Bag, BagTopic
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.nodes.diagnostics import all_acknowledged
from srt3d_ros.nodes.lifecycle import PUBLISH_DEPTH, make_node
from srt3d_ros.nodes.topics import FRAMES, MOTION, OVERRIDABLE, SENSOR, SKETCH, SKETCH_SENSOR, Topic
from srt3d_ros.processes import transport

ACKNOWLEDGE_S, POLL_S = 5.0, 0.02
LOOP_PAUSE_S = 0.1      # before a bag begins again: one of a single frame would flood the network
PLAYED = (*FRAMES, SKETCH)


def main(path: Path, rate: float = 1.0, loop: bool = False) -> int:
    """Publish a bag's messages as they are, `rate` times as fast as recorded, until its end or a signal; returns 0."""
    transport.prepare_process()
    with Bag(path) as bag:
        topics = topics_to_play(bag)
        node = make_node(lambda: rclpy.create_node("player"))
        try:
            _play(node, bag, topics, rate, loop)
        finally:
            node.destroy_node()
            rclpy.try_shutdown()
    return 0


def topics_to_play(bag: Bag) -> dict[BagTopic, Topic]:
    """The bag's topics with names and types of this package, in any namespace; sketches only if it has no photons."""
    # Motion is advertised first, frames last: a subscriber that has discovered the frames has then discovered all.
    found = {topic: kind for kind in (*MOTION, SENSOR, SKETCH_SENSOR, *PLAYED) for topic in bag.topics
             if topic.type == kind.type and re.fullmatch(rf"(/[A-Za-z_]\w*)*/{kind.name}", topic.name, re.ASCII)}
    if any(kind in FRAMES for kind in found.values()):
        found = {topic: kind for topic, kind in found.items() if kind not in (SKETCH, SKETCH_SENSOR)}
    require(not set(PLAYED).isdisjoint(found.values()), "bag", problem=f"bag {bag.path.name} has no topic named "
            f"{', '.join(kind.name for kind in PLAYED)}. It has {bag.content()}.")
    return found


def _play(node: Node, bag: Bag, topics: dict[BagTopic, Topic], rate: float, loop: bool) -> None:
    stop, log = threading.Event(), node.get_logger()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())

    def wait_until(ready: Callable[[], bool], timeout_s: float = threading.TIMEOUT_MAX) -> None:
        end_s = time.monotonic() + timeout_s
        while not ready() and time.monotonic() < end_s and not stop.wait(POLL_S):
            pass

    publishers = {topic.name: _publisher(node, topic.name, kind) for topic, kind in topics.items()}
    frames = [publishers[topic.name] for topic, kind in topics.items() if kind in PLAYED]
    latched = {topic.name for topic, kind in topics.items() if kind.latched}
    log.info(f"plays {', '.join(f'{topic.name} ({topic.messages})' for topic in topics)} and begins when "
             f"{frames[0].topic_name} has a subscriber")
    for note in bag.notes:
        log.warning(note)
    while not stop.is_set():
        begun_s = None
        for name, time_ns, raw in bag.timed_messages(topics):
            if begun_s is None and name not in latched:
                wait_until(lambda: any(publisher.get_subscription_count() for publisher in frames))
                begun_s, first_ns = time.monotonic(), time_ns
            due_s = 0 if begun_s is None else begun_s + (time_ns - first_ns) * 1e-9 / rate - time.monotonic()
            if stop.wait(min(max(due_s, 0), threading.TIMEOUT_MAX)):
                return
            if raw:     # after a message of zero bytes, Fast DDS delivers no other
                publishers[name].publish(raw)
        if not loop:
            wait_until(lambda: all(map(all_acknowledged, publishers.values())), ACKNOWLEDGE_S)
            log.info(f"played {bag.path.name} to its end")
            return
        stop.wait(LOOP_PAUSE_S)


def _publisher(node: Node, name: str, kind: Topic) -> Publisher:
    qos = QoSProfile(depth=1 if kind.latched else PUBLISH_DEPTH, durability=kind.durability)
    try:        # without the first "/", so that namespaces apply
        return node.create_publisher(kind.load(), name[1:], qos, qos_overriding_options=OVERRIDABLE)
    except (RuntimeError, NameValidationException) as error:    # two types on a topic; a name that is too long
        raise InvalidInput("bag", problem=f"Cannot publish {name} ({str(error).partition(chr(10))[0]}).") from None
