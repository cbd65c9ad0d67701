"""Sketcher and reconstructor on two machines with 100 Mbit/s between them: real nodes in network namespaces."""

from contextlib import ExitStack

import pytest

from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.messages import sensor_message
from tools.machines import NETWORK_PROFILE, ROBOT, SENSOR, Link, Machines

SIDE = 141
SKETCH_BYTES = SIDE**2 * (4 + 4 * 5)        # int16, m = 5
OVERHEAD = 1.4                              # of the wire: headers are 16 %; what is sent twice would be more
FRAMES = 12
SLOW_HZ = 2.0       # no frame has to wait, on a busy machine either


@pytest.fixture
def machines(tmp_path):
    """Two machines with a cable, and what starts nodes there."""
    with ExitStack() as stack:
        try:
            link = stack.enter_context(Link(100))
        except (RuntimeError, OSError) as error:
            pytest.skip(f"no two machines here: {error}")
        yield stack.enter_context(Machines(link, tmp_path))


def play(machines, watch, frames: int) -> int:
    """Play so many frames of the simulator and wait until the reconstructor has answered all; bytes on the wire."""
    before, answered = machines.link.wire_bytes(), watch.total("reconstructor", "frames_out")
    machines.start_on(SENSOR, "player", frames=frames, rate_hz=SLOW_HZ)
    machines.wait(lambda: watch.total("reconstructor", "frames_out") >= answered + frames, "the last cloud")
    return machines.link.wire_bytes() - before


def test_every_sketch_passes_over_a_bad_link_once_and_to_a_robot_that_comes_back(machines, tmp_path):
    """The sensor is known, and its frequencies stay, before the first frame: none has to wait for a description."""
    (tmp_path / "sensor.json").write_text(sensor_message.to_json(Simulator().sensor))
    watch = machines.watch("points")
    sketcher = machines.start_on(SENSOR, "sketcher", NETWORK_PROFILE, layout="int16", sketch_size=5,
                                 frequencies="consecutive", sensor_file=str(tmp_path / "sensor.json"))
    reconstructor = machines.start_on(ROBOT, "reconstructor")
    machines.wait(lambda: "sketcher" in watch.reports and watch.total("reconstructor", "cols") == SIDE, "the nodes")

    machines.link.lose(0.01)
    assert FRAMES * SKETCH_BYTES < play(machines, watch, FRAMES) < OVERHEAD * FRAMES * SKETCH_BYTES
    assert watch.total("reconstructor", "messages_in") == len(watch.arrivals) == FRAMES
    assert watch.total("reconstructor", "message_lost") == watch.total("sketcher", "dropped") == 0

    reconstructor.kill()
    machines.link.lose(0)
    machines.link.replug()
    del watch.reports["reconstructor"]
    machines.start_on(ROBOT, "reconstructor")
    machines.wait(lambda: watch.total("reconstructor", "cols") == SIDE, "sketch/sensor")
    play(machines, watch, FRAMES)
    assert watch.total("reconstructor", "messages_in") == FRAMES and sketcher.running
