"""Faults of processes and nodes. Each does its harm, sees that it was done, and takes it back; see faults.py."""

import random
import signal

from faulty import FaultyStack
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from process import REPOSITORY
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python

STOPPED_S = 3.0
TWINS_S, READER_S = 1.5, 3.0
NODES = ("sketcher", "reconstructor", "recorder", "bag_recorder")
IN_THE_WAY = ("sketcher", "reconstructor", "driver")        # without which there is no cloud
LAST_WORDS_S = 3.0
CLEAR_S = 10.0              # for clouds that a fault is not to keep from coming
STEPS = {"configure": Transition.TRANSITION_CONFIGURE, "activate": Transition.TRANSITION_ACTIVATE,
         "deactivate": Transition.TRANSITION_DEACTIVATE, "cleanup": Transition.TRANSITION_CLEANUP}
# Which transitions there are, and one that there is not, from active back to active.
JOURNEYS = (("configure", "deactivate", "activate"),
            ("activate", "deactivate", "deactivate", "activate"),
            ("cleanup", "deactivate", "cleanup", "activate", "configure", "activate"))
STATES = {"unconfigured": {"configure": "inactive"}, "active": {"deactivate": "inactive"},
          "inactive": {"activate": "active", "cleanup": "unconfigured"}}
LEGAL = {
    "sketcher": {"sketch_size": (5, 12), "frequencies": ("1,2,5", "spread"), "window_frames": (3, 2),
                 "layout": ("int16",), "frame_period_s": (0.2,), "frame_id": ("another",)},
    "reconstructor": {"surfaces": (2,), "fields": ("full",), "organised": (True,), "pipeline": ("throughput",),
                      "false_alarm_rate": (0.01,), "warm_start": (True,), "upsampling": (2,), "method": ("smle",)},
}
ILLEGAL = {
    "sketcher": {"sketch_size": (0, -1, 10**6, "ten", 2.5), "frequencies": ("0", "1,1", "", "all"),
                 "window_frames": (0, 10**9), "layout": ("int8",), "frame_period_s": (-1.0, float("nan")),
                 "lossless": (True,)},
    "reconstructor": {"surfaces": (0, 99), "fields": ("none",), "organised": (1,), "false_alarm_rate": (0.0, 2.0),
                      "upsampling": (0, 10**6), "method": ("rt3d", ""), "device": ("tpu",), "min_range_m": (-1.0,)},
    "recorder": {"path": ("x",), "live_port": (-1,)},
    "bag_recorder": {"queue_mb": (0,), "path": ("x",)},
}


def kill(stack: FaultyStack, choice: random.Random) -> dict:
    """kill -9, and a start again."""
    name = choice.choice((*NODES, "driver"))
    process = stack.processes[name]
    process.kill()
    assert process.returncode == -signal.SIGKILL, f"{name} was not killed"
    stack.spin(choice.uniform(0, 1))
    stack.again(name)
    return {"node": name}


def stop(stack: FaultyStack, choice: random.Random) -> dict:
    """SIGSTOP for 3 s, then SIGCONT."""
    name = choice.choice((*NODES, "driver"))
    _stopped(stack, name, STOPPED_S, name not in IN_THE_WAY)
    return {"node": name}


def restart(stack: FaultyStack, choice: random.Random) -> dict:
    """SIGTERM or SIGINT, and a start again."""
    name = choice.choice((*NODES, "driver"))
    number = choice.choice((signal.SIGTERM, signal.SIGINT))
    end(stack, name, number)
    stack.again(name)
    return {"node": name, "signal": signal.Signals(number).name}


def end(stack: FaultyStack, name: str, number: int = signal.SIGTERM) -> None:
    """Have a process end in order, its last report with it; the driver is none that would."""
    process = stack.processes[name]
    process.send(number)
    stack.wait(lambda: not process.running, f"the end of {name}", 60.0)
    if name != "driver":
        assert process.returncode == 0, f"{name} ended with {process.returncode}:\n{process.text}"
        stack.wait(lambda: not stack.unbalanced([name]), "", LAST_WORDS_S, must=False)
        assert not stack.unbalanced([name]), f"the last report of {name} does not balance: {stack.counts.latest[name]}"


def twins(stack: FaultyStack, choice: random.Random) -> dict:
    """Two reconstructors on one topic."""
    stack.start("second", node="reconstructor")
    stack.clouds.clear()
    stack.wait(lambda: len(stack.clouds) - len({cloud.stamp_ns for cloud in stack.clouds}) > 3, "clouds of both")
    stack.spin(TWINS_S)
    twice = len(stack.clouds) - len({cloud.stamp_ns for cloud in stack.clouds})
    if choice.random() < 0.5:
        stack.processes["second"].kill()
    else:
        end(stack, "second")
    stack.leave("second")
    return {"clouds_twice": twice}


def reader(stack: FaultyStack, choice: random.Random) -> dict:
    """A subscriber, reliable, that stops reading: of photons, of sketches or of clouds."""
    topic = choice.choice(("photons", "sketch", "points"))
    process = stack.run("reader", [str(REPOSITORY / "benchmarks" / "watch.py"), topic])
    stack.wait(lambda: "stamp_ns" in process.text, f"the reader to read {topic}")
    _stopped(stack, "reader", READER_S, clouds_go_on=True)
    process.kill()
    stack.leave("reader")
    return {"topic": topic}


def _stopped(stack: FaultyStack, name: str, seconds: float, clouds_go_on: bool) -> None:
    process = stack.processes[name]
    process.halt()
    try:
        stack.spin(seconds)
        assert process.halted, f"{name} was not stopped"
        if clouds_go_on:
            stack.wait_for_cloud(CLEAR_S)
    finally:
        process.go_on()



def lifecycle(stack: FaultyStack, choice: random.Random) -> dict:
    """Transitions there and back, and such as are not possible. (A bag recorder would need another path.)"""
    name = choice.choice(("sketcher", "reconstructor", "recorder"))
    journey, state = choice.choice(JOURNEYS), "active"
    for step in journey:
        goes = step in STATES[state]
        state = STATES[state].get(step, state)
        request = ChangeState.Request(transition=Transition(id=STEPS[step]))
        went = stack.call(ChangeState, f"{name}/change_state", request).success
        assert went == goes, f"{name}: {step} gave {went}"
        label = stack.call(GetState, f"{name}/get_state", GetState.Request()).current_state.label
        assert label == state, f"{name} is {label} after {step}: expected {state}"
    return {"node": name, "journey": " ".join(journey)}


def parameters(stack: FaultyStack, choice: random.Random) -> dict:
    """Parameters changed live: to what they may be, to what they may not, and back."""
    name = choice.choice(NODES)
    legal = [(key, value) for key, values in LEGAL.get(name, {}).items() for value in values]
    changed = choice.sample(legal, min(2, len(legal)))
    refused = 0
    for key, value in changed:
        before = _get(stack, name, key)
        _illegal(stack, name, choice)
        problem = _set(stack, name, key, value)
        assert not problem, f"{name}.{key} := {value} was refused: {problem}"
        assert _get(stack, name, key) == value
        stack.spin(choice.uniform(0, 0.5))
        problem = _set(stack, name, key, before)
        assert not problem, f"{name}.{key} := {before} was refused: {problem}"
        refused += 1
    for _ in range(3):
        refused += _illegal(stack, name, choice)
    return {"node": name, "changed": ", ".join(f"{key}={value}" for key, value in changed), "refused": refused}


def _illegal(stack: FaultyStack, name: str, choice: random.Random) -> int:
    key = choice.choice(list(ILLEGAL[name]))
    value = choice.choice(ILLEGAL[name][key])
    before = _get(stack, name, key)
    problem = _set(stack, name, key, value)
    assert problem, f"{name}.{key} := {value} was taken"
    assert _get(stack, name, key) == before
    return 1


def _set(stack: FaultyStack, name: str, key: str, value) -> str:
    """Why it was refused; empty if it was not."""
    message = Parameter(key, value=value).to_parameter_msg()
    answer, = stack.call(SetParameters, f"{name}/set_parameters", SetParameters.Request(parameters=[message])).results
    return "" if answer.successful else answer.reason or "no reason"


def _get(stack: FaultyStack, name: str, key: str):
    answer = stack.call(GetParameters, f"{name}/get_parameters", GetParameters.Request(names=[key]))
    return parameter_value_to_python(answer.values[0])
