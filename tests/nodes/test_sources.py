"""What the player plays, message by message: what is due when, with which stamps, and where it begins and ends."""

from itertools import chain, islice, pairwise, repeat

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.datasets.simulation.motion_profiles import OPTICAL
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import photon_frames, sensor_message
from srt3d_ros.nodes import player, sources
from srt3d_ros.nodes.sources import BEFORE_S, PACKETS, open_source
from tests.photon_forms import as_histograms

BEFORE_NS, MS = round(BEFORE_S * 1e9), 1_000_000
DEFAULTS = {parameter.name: parameter.default for parameter in player.PARAMETERS}


def source(**given):
    """The source that these parameters describe, ready to play."""
    opened = open_source(DEFAULTS | given, given)
    opened.prepare(lambda: False)
    return opened


def test_a_file_of_counts_is_played_photon_by_photon(tmp_path, sensor, events):
    counts = as_histograms(events, sensor).counts
    np.savez(tmp_path / "counts.npz", counts=counts, bin_width_s=sensor.bin_width_s, irf=sensor.irf)
    (tmp_path / "sensor.json").write_text(sensor_message.to_json(sensor))
    played = source(input=str(tmp_path / "counts.npz"), sensor_file=str(tmp_path / "sensor.json"), frames=1)
    frame, = played.items(lambda: 0)
    sent = photon_frames.PHOTONS.decode_cdr(frame.raw, sensor)[1]
    assert frame.topic == "photons" and sorted(zip(sent.pixel, sent.toa)) == sorted(zip(events.pixel, events.toa))


@pytest.mark.parametrize("given, packets", [({}, 1), ({"motion": "walk"}, PACKETS)])
def test_cycles_of_a_simulated_frame_make_its_photons_pile_up(given, packets):
    def played(cycles: int) -> int:
        piled = source(frames=1, ppp=2.0, cycles=cycles, **given)
        assert piled.sensor.cycles == (cycles // packets or None)
        items = [item for item in piled.items(lambda: 0) if item.topic == "photons"]
        return sum(photon_frames.PHOTONS.decode_cdr(item.raw, piled.sensor)[1].photons for item in items)

    assert played(20) < 0.99 * played(0)


@pytest.mark.parametrize("given, line", [
    ({"input": "nowhere.npz"}, "nowhere.npz"),
    ({"sensor_file": "sensor.json"}, "sensor_file sensor.json: only for a photon file, and input simulator is the"),
    ({"input": "a.npz", "sbr": 2.0}, "sbr 2.0: only for the simulator, and input a.npz is a photon file"),
    ({"input": "bag.mcap"}, "input is bag.mcap: expected a photon file or simulator; `ros2 bag play` plays bags"),
])
def test_what_is_no_source_is_refused(given, line):
    with pytest.raises(InvalidInput, match=line):
        source(**given)


@pytest.mark.parametrize("given", [{}, {"motion": "walk", "ppp": 1.0}])
def test_what_is_late_is_skipped_by_whole_frames_and_the_number_that_was_asked_for_is_sent(given):
    clock = chain([0, 0], repeat(1_750 * MS))       # leaps ahead before the third frame
    items = source(frames=4, rate_hz=10.0, **given).items(lambda: next(clock))
    items = [item for item in items if item.topic == "photons"]
    packets = PACKETS if given else 1
    assert len(items) == 4 * packets
    first = items[::packets]
    jump = first[2].skipped
    assert jump > 9 and jump == sum(item.skipped for item in items)
    assert (np.diff([item.stamp_ns for item in first]) / (100 * MS)).tolist() == [1, 1 + jump, 1]


def test_scenes_are_drawn_before_repeat_without_a_jump_and_stay_within_a_limit(monkeypatch):
    played = source(ppp=2.0, rate_hz=20.0)
    with monkeypatch.context() as patch:
        patch.setattr(Simulator, "frame", None)     # nothing more can be drawn
        frames = [item.raw for item in islice(played.items(lambda: 0), 81)]
    assert frames[80] == frames[0] != frames[1]
    depths = [Simulator(ppp=2.0).expected(k)[0] for k in (0, 80)]
    np.testing.assert_allclose(*depths, atol=0.1)   # bins
    monkeypatch.setattr(sources, "MAX_DRAWN_BYTES", 500_000)
    frames = [item.raw for item in islice(source(ppp=1.0).items(lambda: 0), 20)]
    one_lap = frames.index(frames[0], 1)
    assert frames[one_lap:2 * one_lap] == frames[:one_lap] and 500_000 <= sum(map(len, frames[:one_lap])) < 700_000


# ---- A sensor that moves: packets and odometry of one time

@pytest.fixture
def moving():
    return lambda **given: source(**{"motion": "walk", "frames": 1} | given)


def test_packets_come_when_they_are_acquired_among_odometry_that_covers_them(moving):
    items = list(moving(rate_hz=20.0, ppp=2.0).items(lambda: 0))
    assert all(before.due_ns <= after.due_ns for before, after in pairwise(items))
    packets = [item for item in items if item.topic == "photons"]
    assert [item.stamp_ns for item in packets] == [BEFORE_NS + k * 5 * MS for k in range(PACKETS)]
    assert [item.due_ns - item.stamp_ns for item in packets] == [5 * MS] * PACKETS
    stamps = [item.stamp_ns for item in items if item.topic == "odom"]
    assert stamps[0] == 0 and stamps[-1] >= BEFORE_NS + 100 * MS and set(np.diff(stamps)) == {10 * MS}


def test_odometry_repeats_with_packets_that_do_and_its_extrinsics_are_where_the_sensor_is(moving, monkeypatch):
    monkeypatch.setattr(sources, "MAX_DRAWN_BYTES", 1)      # a lap of one frame, of 100 ms
    items = moving(ppp=1.0, frames=3).items(lambda: 0)
    heights = {item.stamp_ns // MS: deserialize_message(item.raw, Odometry).pose.pose.position.z
               for item in items if item.topic == "odom"}
    assert heights[510] == pytest.approx(heights[610], abs=1e-9) == heights[710]
    assert abs(heights[520] - heights[510]) > 1e-4
    note, = moving().notes
    np.testing.assert_allclose(Pose.from_text(note.split("'")[-2]).rotation, OPTICAL.rotation, atol=1e-9)
