"""What the player plays, message by message: what is due when, with which stamps, and where it begins and ends."""

from itertools import pairwise

import numpy as np
import pytest

from srt3d_ros.core.sketching.photons import PhotonEvents
from srt3d_ros.datasets.simulation.motion_profiles import OPTICAL
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages.photon_frames import CODECS
from srt3d_ros.nodes import player
from srt3d_ros.nodes.motion_input import parse_extrinsics
from srt3d_ros.nodes.sources import BEFORE_S, PACKETS, FrameSource, MovingSource, open_source

BEFORE_NS, MS = round(BEFORE_S * 1e9), 1_000_000
DEFAULTS = {parameter.name: parameter.default for parameter in player.PARAMETERS}


def source(**given) -> FrameSource:
    """The source that these parameters describe."""
    return open_source(DEFAULTS | given)


def same_photons(one: PhotonEvents, other: PhotonEvents) -> bool:
    """True if both hold the same photons in any order."""
    return sorted(zip(one.pixel, one.toa)) == sorted(zip(other.pixel, other.toa))


@pytest.mark.parametrize("output", ["gates", "histograms"])
def test_the_frame_of_a_file_is_sent_in_other_forms_too(photon_file, events, output):
    played = source(input=str(photon_file), frames=1, output=output)
    frame, = played.items()
    described = sensor_message.decode_cdr(played.sensor)
    assert frame.topic == output
    assert same_photons(CODECS[output].decode_cdr(frame.raw, described)[1].to_events(described), events)


@pytest.mark.parametrize("given, line", [
    ({"input": "nowhere.npz"}, "nowhere.npz"),
    ({"sensor_file": "sensor.json"}, "sensor_file is sensor.json: expected nothing, unless a photon file is played"),
    ({"input": "bag.mcap"}, "input is bag.mcap: expected a photon file or simulator: ros2 bag play plays bags"),
])
def test_what_is_no_source_is_refused(given, line):
    with pytest.raises(InvalidInput, match=line):
        source(**given)


# ---- A sensor that moves: packets and odometry of one time

@pytest.fixture
def moving():
    return lambda **given: MovingSource(DEFAULTS | {"motion": "walk", "frames": 1} | given)


def test_packets_come_when_they_are_acquired_among_odometry_that_covers_them(moving):
    items = list(moving(rate_hz=20.0, ppp=2.0).items())
    assert all(before.due_ns <= after.due_ns for before, after in pairwise(items))
    packets = [item for item in items if item.topic == "photons"]
    assert [item.stamp_ns for item in packets] == [BEFORE_NS + k * 5 * MS for k in range(PACKETS)]
    assert [item.due_ns - item.stamp_ns for item in packets] == [5 * MS] * PACKETS
    stamps = [item.stamp_ns for item in items if item.topic == "odom"]
    assert stamps[0] == 0 and stamps[-1] >= BEFORE_NS + 100 * MS and set(np.diff(stamps)) == {10 * MS}


def test_the_extrinsics_that_it_tells_are_where_the_sensor_is(moving):
    note, = moving().notes
    np.testing.assert_allclose(parse_extrinsics(note.split("'")[-2]).rotation, OPTICAL.rotation, atol=1e-9)
