"""The faults. Each does its harm, checks that it was done, takes it back, and returns a few words on what it did."""

import os
import random
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from builtin_interfaces.msg import Time
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from robustness.fault_testbed import SENSORS, FaultTestbed
from srt3d_ros.processes import STOP_TIMEOUT_S, node_command

RECORDERS = ("recorder", "bag_recorder")
NODES = ("sketcher", "reconstructor", *RECORDERS)
HELD_S, STOPPED_S = 2.0, 3.0
LATE_S = 0.6                # more than a late packet is late
SHARE = 0.3                 # of the packets
JUMPS_S = (-100.0, 1000.0, -5.0, 3.0)
CLOUD_S = 10.0              # for clouds that a fault must not stop
RECORDER_S = 60.0           # until the recorder has nothing more to flush and finds out
MB, LEAKED_MB, OLD_S = 2**20, 40, 100.0


@dataclass(frozen=True)
class Fault:
    """A fault.

    Args:
        do: (testbed, random numbers) → what it did, in words.
        on_own_disks: it needs a mount namespace.
        counted: neither driver nor sketcher is harmed: the sketcher accounts for every packet sent.
    """

    do: Callable[[FaultTestbed, random.Random], str]
    on_own_disks: bool = False
    counted: bool = False


def end(testbed: FaultTestbed, name: str, number: int) -> None:
    """End a process; in order, its last diagnostics must balance, but the driver has none."""
    process = testbed[name]
    process.send(number)
    testbed.wait(lambda: not process.running, f"the end of {name}", STOP_TIMEOUT_S)
    if name != "driver" and number != signal.SIGKILL:
        assert process.returncode == 0, f"{name} {process.ending}:\n{process.text}"
        balanced = testbed.saw(lambda: not testbed.unbalanced([name]), LATE_S + STOPPED_S)
        assert balanced, f"the last report of {name} does not balance: {testbed.latest[name]}"


def restart(testbed: FaultTestbed, choice: random.Random, *, numbers: tuple[int, ...]) -> str:
    name, number = choice.choice((*NODES, "driver")), choice.choice(numbers)
    end(testbed, name, number)
    testbed.spin(choice.uniform(0, 1))
    testbed.start(name)
    return f"{name}, {signal.Signals(number).name}"


def pause(testbed: FaultTestbed, choice: random.Random) -> str:
    """Clouds must go on meanwhile where the process only listens, as a reliable subscriber that stops reading."""
    name = choice.choice((*NODES, "driver"))
    testbed[name].halt()
    try:
        testbed.spin(STOPPED_S)
        assert testbed[name].halted, f"{name} was not stopped"
        if name in RECORDERS:
            testbed.wait_for_cloud(CLOUD_S)
    finally:
        testbed[name].go_on()
    return name


def twins(testbed: FaultTestbed, choice: random.Random) -> str:
    testbed.run("second", node_command("reconstructor", "-r", "__node:=second"), is_node=True)
    testbed.wait_ready("second")
    testbed.clouds.clear()
    testbed.wait(lambda: len(testbed.clouds) > len(set(testbed.clouds)) + 3, "clouds of both")
    end(testbed, "second", choice.choice((signal.SIGKILL, signal.SIGTERM)))
    testbed.remove("second")
    return "two reconstructors"


def packets(testbed: FaultTestbed, choice: random.Random, *, fate: str, cause: str) -> str:
    """The driver does this to packets; the sketcher drops them for this cause, if any, and for no other.

    A busy machine drops some before they are read (queue), or leaves their frame too late.
    """
    before, counted = testbed.drive(), testbed.totals("sketcher")
    testbed.drive(**{fate: SHARE})
    testbed.spin(HELD_S)
    testbed.drive(**{fate: 0})
    testbed.spin(LATE_S)
    testbed.drive(sensor="")
    testbed.settle(["sketcher"])
    driver, sketcher = testbed.drive(sensor=testbed.sensor) - before, testbed.totals("sketcher") - counted
    done, dropped = driver[fate], sketcher[f"dropped.{cause}"]
    busy = {other: sketcher[f"dropped.{other}"] for other in {"queue", "late"} - {cause}}
    assert done and sketcher["dropped"] == dropped + sum(busy.values()), f"of {driver} {sketcher} came out"
    if cause:
        assert dropped == done or 0 < dropped < done and (any(busy.values()) or sketcher["message_lost"]), sketcher
    return f"{done} times"


def sensor(testbed: FaultTestbed, choice: random.Random, *, comes_back: bool) -> str:
    """Another size, T or IRF: from a driver that comes back, or in the middle of a frame."""
    name = choice.choice([name for name in SENSORS if name != testbed.sensor])
    testbed.spin(choice.uniform(0, 0.1))
    if comes_back:
        testbed["driver"].kill()
        testbed.sensor = name
        testbed.start("driver")
    else:
        testbed.drive(sensor=name)
    return name


def clock(testbed: FaultTestbed, choice: random.Random) -> str:
    """Simulated time jumps back and forth, and the stamps with it."""
    publisher = testbed.probe.node.create_publisher(Clock, "/clock", 10)
    shift_s = 0.0
    try:
        _follow_clock(testbed, True)
        for jump_s in choice.sample(JUMPS_S, 3):
            shift_s += jump_s
            testbed.drive(shift_s=shift_s)
            timer = testbed.probe.node.create_timer(0.05, lambda: publisher.publish(
                Clock(clock=Time(sec=testbed.stamp_ns() // 10**9, nanosec=testbed.stamp_ns() % 10**9))))
            testbed.spin(1.0)
            testbed.wait_for_cloud(CLOUD_S)
            testbed.probe.node.destroy_timer(timer)
    finally:
        _follow_clock(testbed, False)
        testbed.drive(shift_s=0.0)
        testbed.probe.node.destroy_publisher(publisher)
    return f"{shift_s:+g} s in the end"


def _follow_clock(testbed: FaultTestbed, follow: bool) -> None:
    request = SetParameters.Request(parameters=[Parameter("use_sim_time", value=follow).to_parameter_msg()])
    for name in NODES:
        answer, = testbed.probe.call(SetParameters, f"{name}/set_parameters", request).results
        assert answer.successful, answer.reason


def disk_full(testbed: FaultTestbed, choice: random.Random) -> str:
    """No room for the recording: one error, clouds go on; with room again, a new file."""
    errors, path = testbed.totals("recorder")["errors"], testbed.probe.value("recorder", "path")
    testbed.disk.fill()
    try:
        testbed.wait(lambda: testbed.totals("recorder")["errors"] > errors, "the recorder's error", RECORDER_S)
        testbed.wait_for_cloud(CLOUD_S)
    finally:
        testbed.disk.empty()
    testbed.wait(lambda: testbed.probe.value("recorder", "path") not in ("", path), "another recording", RECORDER_S)
    return f"after {path}"


def disk_read_only(testbed: FaultTestbed, choice: random.Random) -> str:
    """A recording is finished, and the next begun on a disk that is read-only by now."""
    errors = testbed.totals("recorder")["errors"]
    assert testbed.probe.call(Trigger, "recorder/stop_recording", Trigger.Request()).success
    testbed.disk.remount("ro")
    try:
        testbed.probe.call(Trigger, "recorder/start_recording", Trigger.Request())
        testbed.wait(lambda: testbed.totals("recorder")["errors"] > errors, "the recorder's error", RECORDER_S)
        testbed.wait_for_cloud(CLOUD_S)
    finally:
        testbed.disk.remount("rw")
    recorded = testbed.totals("recorder")["frames_out"]
    testbed.wait(lambda: testbed.totals("recorder")["frames_out"] > recorded + 5, "another recording", RECORDER_S)
    return "and back"


def shared_memory_full(testbed: FaultTestbed, choice: random.Random) -> str:
    """No room in /dev/shm, for those who run and for one who starts."""
    name = choice.choice((*NODES, "driver"))
    testbed.shared_memory.fill()
    try:
        testbed.wait_for_cloud(CLOUD_S)
        end(testbed, name, signal.SIGTERM)
        testbed.shared_memory.fill()
        testbed.start(name)
        testbed.wait_for_cloud(CLOUD_S)
    finally:
        testbed.shared_memory.empty()
    return name


def shared_memory_leaked(testbed: FaultTestbed, choice: random.Random) -> str:
    """/dev/shm is full of what killed processes left: a process that starts removes it."""
    name, leaked = choice.choice((*NODES, "driver")), []
    while testbed.shared_memory.free_bytes > LEAKED_MB * MB:
        path = testbed.shared_memory.folder / f"fastrtps_{choice.getrandbits(64):016x}"
        for part, size in ((path, LEAKED_MB * MB), (path.with_name(f"{path.name}_el"), 1)):
            with part.open("wb") as file:
                os.posix_fallocate(file.fileno(), 0, size)
            os.utime(part, (time.time() - OLD_S,) * 2)
        leaked.append(path)
    assert leaked, "there was no room to leak"
    end(testbed, name, signal.SIGTERM)
    testbed.start(name)
    left = [path for path in leaked if path.exists()]
    assert not left, f"{len(left)} of {len(leaked)} leaked segments still exist"
    return f"{name}, {len(leaked)} segments"


FAULTS = {
    "kill": Fault(partial(restart, numbers=(signal.SIGKILL,))),
    "restart": Fault(partial(restart, numbers=(signal.SIGTERM, signal.SIGINT))),
    "stop": Fault(pause), "twins": Fault(twins),
    "lost": Fault(partial(packets, fate="lose", cause=""), counted=True),
    "doubled": Fault(partial(packets, fate="double", cause="duplicate"), counted=True),
    "late": Fault(partial(packets, fate="late", cause="late"), counted=True),
    "cut": Fault(partial(packets, fate="cut", cause="malformed"), counted=True),
    "shuffled": Fault(partial(packets, fate="shuffle", cause=""), counted=True),
    "sensor": Fault(partial(sensor, comes_back=True)), "replaced": Fault(partial(sensor, comes_back=False)),
    "clock": Fault(clock), "disk_full": Fault(disk_full, on_own_disks=True),
    "disk_read_only": Fault(disk_read_only, on_own_disks=True),
    "shared_memory_full": Fault(shared_memory_full, on_own_disks=True),
    "shared_memory_leaked": Fault(shared_memory_leaked, on_own_disks=True),
}
