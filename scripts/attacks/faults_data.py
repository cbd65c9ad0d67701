"""Faults of what the sensor sends, and of time. Each sees that it was done, and takes it back; see faults.py."""

import random
import time
from collections import Counter

from builtin_interfaces.msg import Time
from faulty import FaultyStack
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

HELD_S = 2.0
LATE_S = 0.6                # more than a late packet is late
SHARE = 0.3                 # of the packets
CALM = {"lose": 0.0, "double": 0.0, "late": 0.0, "shuffle": False}
JUMPS_S = (-100.0, 1000.0, -5.0, 3.0)
CLOCK_S, TICK_S = 1.0, 0.05
FOLLOW_TIME = ("sketcher", "reconstructor", "recorder", "bag_recorder")


def lost(stack: FaultyStack, choice: random.Random) -> dict:
    """Packets that never come."""
    driver, _ = _misbehave(stack, lose=SHARE)
    assert driver["lost"], "no packet was lost"
    return {"packets": driver["lost"], "intact": True}


def doubled(stack: FaultyStack, choice: random.Random) -> dict:
    """Packets that come twice: used once."""
    driver, sketcher = _misbehave(stack, double=SHARE)
    assert 0 < sketcher["dropped.duplicate"] <= driver["doubled"], f"of {driver} {sketcher} came out"
    # Late instead: of a frame that a driver which got no time has left open for too long.
    _check_all(sketcher, "duplicate", driver["doubled"], lost_before=sketcher["dropped.late"])
    return {"packets": driver["doubled"], "intact": True}


def late(stack: FaultyStack, choice: random.Random) -> dict:
    """Packets that come after their frame has ended: none is used."""
    driver, sketcher = _misbehave(stack, late=SHARE)
    assert 0 < sketcher["dropped.late"] <= driver["late"], f"of {driver} {sketcher} came out"
    _check_all(sketcher, "late", driver["late"])
    return {"packets": driver["late"], "intact": True}


def _check_all(sketcher: Counter, cause: str, packets: int, lost_before: int = 0) -> None:
    """All were dropped for that cause, unless a busy machine had dropped some before they were looked at."""
    lost_before += sketcher["dropped.queue"] + sketcher["message_lost"]
    assert sketcher[f"dropped.{cause}"] == packets or lost_before, f"{packets} packets: {sketcher}"


def shuffled(stack: FaultyStack, choice: random.Random) -> dict:
    """A frame's packets at once, in any order: none is lost but those that come after their period."""
    driver, sketcher = _misbehave(stack, shuffle=True)
    assert driver["shuffled"], "no frame was shuffled"
    others = sketcher["dropped"] - sketcher["dropped.queue"] - sketcher["dropped.late"]
    assert not others, f"{others} packets were dropped for other causes: {sketcher}"
    return {"frames": driver["shuffled"], "intact": True}


def _misbehave(stack: FaultyStack, **settings) -> tuple[Counter, Counter]:
    """What driver and sketcher counted while the driver did so, after all of it has come."""
    before, counted = stack.drive(), stack.counts.totals("sketcher")
    stack.drive(**settings)
    stack.spin(HELD_S)
    stack.drive(**CALM)
    stack.spin(LATE_S)                      # what is late still comes
    stack.drive(sensor="")
    stack.settle(["sketcher"])
    after = stack.drive()
    driver, sketcher = after - before, stack.counts.totals("sketcher") - counted
    stack.resume()
    return driver, sketcher


def sensor(stack: FaultyStack, choice: random.Random) -> dict:
    """The driver dies and comes back as another sensor: of another size, T or IRF."""
    name = choice.choice([name for name in stack.models if name != stack.sensor])
    stack.processes["driver"].kill()
    stack.sensor = name
    stack.start_driver()
    stack.wait(lambda: stack.described is not None and stack.described.same_as(stack.models[name]),
               f"sketch/sensor to tell of {name}")
    return {"sensor": name}


def replaced(stack: FaultyStack, choice: random.Random) -> dict:
    """As before, but the driver lives on, and describes another sensor in the middle of a frame."""
    name = choice.choice([name for name in stack.models if name != stack.sensor])
    stack.spin(choice.uniform(0, 0.1))
    stack.drive(sensor=name)
    stack.wait(lambda: stack.described is not None and stack.described.same_as(stack.models[name]),
               f"sketch/sensor to tell of {name}")
    return {"sensor": name}


def clock(stack: FaultyStack, choice: random.Random) -> dict:
    """Simulated time that jumps back and forth, and the stamps with it."""
    publisher = stack.monitor.node.create_publisher(Clock, "/clock", 10)
    try:
        _follow(stack, True)
        for jump_s in choice.sample(JUMPS_S, 3):
            stack.drive(shift_s=stack.shift_s + jump_s)
            since_ns, end = stack.stamp_ns(), time.monotonic() + CLOCK_S
            while time.monotonic() < end:
                publisher.publish(Clock(clock=Time(sec=stack.stamp_ns() // 10**9, nanosec=stack.stamp_ns() % 10**9)))
                stack.spin(TICK_S)
            stack.wait(lambda: stack.new_clouds(since_ns), f"clouds after a jump of {jump_s} s")
            # by the time that jumps, no frame is older than a second: so it is followed
        latency_ms = float(stack.value("sketcher", "latency_p50_ms"))
    finally:
        _follow(stack, False)
        stack.drive(shift_s=0.0)
        stack.monitor.node.destroy_publisher(publisher)
    return {"latency_ms": latency_ms}


def _follow(stack: FaultyStack, simulated: bool) -> None:
    request = SetParameters.Request(parameters=[Parameter("use_sim_time", value=simulated).to_parameter_msg()])
    for name in FOLLOW_TIME:
        answer, = stack.call(SetParameters, f"{name}/set_parameters", request).results
        assert answer.successful, answer.reason
