"""The faults. Each does its harm, checks that it was done, takes it back, and returns a few words on what it did."""

import os
import random
import signal
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from builtin_interfaces.msg import Time
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
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
STEPS = {"configure": Transition.TRANSITION_CONFIGURE, "activate": Transition.TRANSITION_ACTIVATE,
         "deactivate": Transition.TRANSITION_DEACTIVATE, "cleanup": Transition.TRANSITION_CLEANUP}
# From active back to active; a step after ! is not possible there and must be refused.
JOURNEYS = ("!configure deactivate activate", "!activate deactivate !deactivate activate",
            "!cleanup deactivate cleanup !activate configure activate")
# Value before, values that are accepted, values that are refused.
LIVE = {("sketcher", "sketch_size"): (0, (5, 12), (-1, 10**6, "ten")),
        ("sketcher", "window_frames"): (1, (3, 2), (0, 10**9)),
        ("sketcher", "layout"): ("coded", ("int16", "float32"), ("int8",)),
        ("reconstructor", "surfaces"): (1, (2,), (0, 99)),
        ("reconstructor", "method"): ("pooled", ("smle",), ("rt3d", "")),
        ("reconstructor", "false_alarm_rate"): (None, (0.01,), (0.0, 2.0)),
        ("recorder", "path"): (None, (), ("x",)), ("bag_recorder", "path"): (None, (), ("x",))}


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
    testbed.wait(lambda: len(testbed.clouds) - len({cloud.stamp_ns for cloud in testbed.clouds}) > 3, "clouds of both")
    end(testbed, "second", choice.choice((signal.SIGKILL, signal.SIGTERM)))
    testbed.remove("second")
    return "two reconstructors"


def lifecycle(testbed: FaultTestbed, choice: random.Random) -> str:
    name, journey = choice.choice(("sketcher", "reconstructor", "recorder")), choice.choice(JOURNEYS)
    for step in journey.split():
        request = ChangeState.Request(transition=Transition(id=STEPS[step.lstrip("!")]))
        went = testbed.probe.call(ChangeState, f"{name}/change_state", request).success
        assert went != step.startswith("!"), f"{name}: {step} gave {went}"
    return f"{name}: {journey}"


def parameters(testbed: FaultTestbed, choice: random.Random) -> str:
    (name, key), (before, legal, illegal) = choice.choice(list(LIVE.items()))
    for value in choice.sample(legal, len(legal)):
        _set(testbed, name, key, value)
        testbed.spin(choice.uniform(0, 0.5))
    for value in illegal:
        assert not _set(testbed, name, key, value, must=False), f"{name}.{key} := {value} was accepted"
    if legal:
        _set(testbed, name, key, before)
    return f"{name}.{key}"


def _set(testbed: FaultTestbed, name: str, key: str, value, must: bool = True) -> bool:
    request = SetParameters.Request(parameters=[Parameter(key, value=value).to_parameter_msg()])
    answer, = testbed.probe.call(SetParameters, f"{name}/set_parameters", request).results
    assert answer.successful or not must, f"{name}.{key} := {value} was refused: {answer.reason}"
    return answer.successful


def packets(testbed: FaultTestbed, choice: random.Random, *, fate: str, cause: str) -> str:
    """The sketcher counts each as what it is, unless a busy machine dropped some before they were read."""
    driver, sketcher = _misbehave(testbed, **{fate: SHARE})
    done, dropped = driver[fate], sketcher[f"dropped.{cause}"] if cause else 0
    otherwise = sketcher["dropped.queue"] + sketcher["message_lost"] + sketcher["dropped.late"] * (cause != "late")
    assert done, "nothing was done"
    assert not cause or dropped == done or 0 < dropped < done and otherwise, f"of {driver} {sketcher} came out"
    return f"{done} packets"


def shuffle(testbed: FaultTestbed, choice: random.Random) -> str:
    driver, sketcher = _misbehave(testbed, shuffle=True)
    others = sketcher["dropped"] - sketcher["dropped.queue"] - sketcher["dropped.late"]
    assert driver["shuffle"] and not others, f"of {driver} {sketcher} came out"
    return f"{driver['shuffle']} frames"


def _misbehave(testbed: FaultTestbed, **settings) -> tuple[Counter, Counter]:
    """What driver and sketcher counted while the driver did so, after all of it has come."""
    before, counted = testbed.drive(), testbed.totals("sketcher")
    testbed.drive(**settings)
    testbed.spin(HELD_S)
    testbed.drive(**dict.fromkeys(settings, 0))
    testbed.spin(LATE_S)
    testbed.drive(sensor="")
    testbed.settle(["sketcher"])
    after = testbed.drive(sensor=testbed.sensor)
    return after - before, testbed.totals("sketcher") - counted


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
    testbed.wait_for_description()
    return name


def clock(testbed: FaultTestbed, choice: random.Random) -> str:
    """Simulated time jumps back and forth, and the stamps with it."""
    publisher = testbed.probe.node.create_publisher(Clock, "/clock", 10)
    shift_s = 0.0
    try:
        for name in NODES:
            _set(testbed, name, "use_sim_time", True)
        for jump_s in choice.sample(JUMPS_S, 3):
            shift_s += jump_s
            testbed.drive(shift_s=shift_s)
            timer = testbed.probe.node.create_timer(0.05, lambda: publisher.publish(
                Clock(clock=Time(sec=testbed.stamp_ns() // 10**9, nanosec=testbed.stamp_ns() % 10**9))))
            testbed.spin(1.0)
            testbed.wait_for_cloud(CLOUD_S)
            testbed.probe.node.destroy_timer(timer)
    finally:
        for name in NODES:
            _set(testbed, name, "use_sim_time", False)
        testbed.drive(shift_s=0.0)
        testbed.probe.node.destroy_publisher(publisher)
    return f"{shift_s:+g} s in the end"


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
    "stop": Fault(pause), "twins": Fault(twins), "lifecycle": Fault(lifecycle), "parameters": Fault(parameters),
    "lost": Fault(partial(packets, fate="lose", cause=""), counted=True),
    "doubled": Fault(partial(packets, fate="double", cause="duplicate"), counted=True),
    "late": Fault(partial(packets, fate="late", cause="late"), counted=True),
    "cut": Fault(partial(packets, fate="cut", cause="malformed"), counted=True),
    "shuffled": Fault(shuffle, counted=True),
    "sensor": Fault(partial(sensor, comes_back=True)), "replaced": Fault(partial(sensor, comes_back=False)),
    "clock": Fault(clock), "disk_full": Fault(disk_full, on_own_disks=True),
    "disk_read_only": Fault(disk_read_only, on_own_disks=True),
    "shared_memory_full": Fault(shared_memory_full, on_own_disks=True),
    "shared_memory_leaked": Fault(shared_memory_leaked, on_own_disks=True),
}
