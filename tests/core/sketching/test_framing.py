"""Framing alone: which packets make which frame, whatever order they come in, and who sends them."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srt3d_ros.core.sketching.framing import Framing, Placed

MS = 1_000_000
S = 1_000 * MS


def frames_of(framing: Framing, stamps) -> tuple[list[list[int]], dict[str, list[int]]]:
    """The stamps of each frame that ended, and of the packets that were dropped, by cause; then the open frame last."""
    frames, open_frame, dropped = [], [], {}
    for stamp in stamps:
        placed = framing.place(stamp)
        if placed.closed:
            assert placed.closed == (len(open_frame), sum(open_frame))
            ends = framing.period_ns or not placed.began_again
            (frames if ends else dropped.setdefault("incomplete", [])).append(open_frame)
            open_frame = []
        if placed.late:
            dropped.setdefault("late", []).append(stamp)
            continue
        open_frame.append(stamp)
        if completed := framing.add(stamp, photons=stamp):
            assert completed == (len(open_frame), sum(open_frame))
            frames.append(open_frame)
            open_frame = []
        assert framing.open == (len(open_frame), sum(open_frame))
    dropped["incomplete"] = sum(dropped.get("incomplete", []), [])
    return [*frames, open_frame], {cause: packets for cause, packets in dropped.items() if packets}


@pytest.mark.parametrize(("packets", "period_ns", "stamps", "frames", "late"), [
    (3, 0, [1, 2, 3, 4, 5, 6, 7], [[1, 2, 3], [4, 5, 6], [7]], []),
    (3, 30, [0, 10, 20], [[0, 10, 20], []], []),                                        # complete: ends at once
    (3, 30, [0, 10, 20, 30, 50, 60], [[0, 10, 20], [30, 50], [60]], []),                # lacks one: with the next
    (1, 100, [0, 10, 90, 40, 100, 260, 210, 540], [[0, 10, 90, 40], [100], [260, 210], [540]], []),
    (1, 33, [0, 0, 0, 33, 33, 67, 100, 100], [[0, 0, 0], [33, 33], [67], [100, 100]], []),
    (2, 0, [10, 30, 20, 40, 9, 19, 30], [[10, 30], [20, 40], [30]], [9, 19]),
    (1, 100, [0, 20, 100, 60, 140, 89, 0], [[0, 20], [100, 140]], [60, 89, 0]),
    (1, 0, [5, 9, 7, 9], [[5], [9], [9], []], [7]),
    (1, 0, [0, 10, 20, 11, 5, 4, 15], [[0], [10], [20], [5], [15], []], [11, 4]),       # more than a frame back
    (1, 0, 3 * [0, 100, 200], [*3 * [[0], [100], [200]], []], []),                      # a bag that is played in a loop
    (1, 0, 3 * [*range(10)], [*3 * [[k] for k in range(10)], []], []),
    (2, 0, 3 * [0, 10, 100, 110, 200, 210], [*3 * [[0, 10], [100, 110], [200, 210]], []], []),
    (1, 100, 2 * [0, 10, 100, 110, 200, 210], 2 * [[0, 10], [100, 110], [200, 210]], []),
    (2, 100, 2 * [0, 10, 100, 110, 200, 210], [*2 * [[0, 10], [100, 110], [200, 210]], []], [])])
def test_frames_end_by_number_and_period_and_what_is_older_is_late(packets, period_ns, stamps, frames, late):
    found, dropped = frames_of(Framing(packets, period_ns), stamps)
    assert found == frames and dropped == ({"late": late} if late else {})


@pytest.mark.parametrize("jitter", [[0, 3, -3, 1, 4, -4, -1, 2], [1, -1, 2, 0, -2, 1, -1, 0]])
def test_stamps_that_jitter_stay_in_their_period(jitter):
    stamps = [10 * k + jitter[k % len(jitter)] for k in range(40)]
    assert [len(frame) for frame in frames_of(Framing(period_ns=100), stamps)[0]] == [10, 10, 10, 10]


@pytest.mark.parametrize("start", [7 * S, 102 * S], ids=["earlier", "later"])
def test_stamps_that_begin_again_are_followed_and_the_open_frame_is_given_up_if_it_waits_for_more(start):
    before, again = ([first + 10 * MS * k for k in range(count)] for first, count in ((100 * S, 5), (start, 6)))
    frames, dropped = frames_of(Framing(packets=3), [*before, *again])
    assert frames == [before[:3], again[:3], again[3:], []] and dropped == {"incomplete": before[3:]}
    frames, dropped = frames_of(Framing(period_ns=30 * MS), [*before, *again])
    assert frames == [before[:3], before[3:], again[:3], again[3:]] and dropped == {}


@pytest.mark.parametrize("framing, steps_s", [
    (Framing(), [2.0] * 12), (Framing(packets=3), [2.0] * 12), (Framing(packets=4), [0.01, 0.01, 0.01, 6.0] * 4),
    (Framing(period_ns=6 * S), [0.01, 0.01, 0.01, 6.0] * 4)], ids=["slow", "slow packets", "pauses", "periods"])
def test_a_slow_sensor_does_not_begin_again_with_each_packet_but_with_a_leap(framing, steps_s):
    stamp, steps_ns = 0, [round(step * S) for step in steps_s]
    placed = []
    for step in (*steps_ns, *steps_ns, 100 * S, *steps_ns):
        placed.append(framing.place(stamp))
        framing.add(stamp)
        stamp += step
    known = 9       # packets, after two pauses
    assert [k for k, one in enumerate(placed) if one.began_again and k >= known] == [2 * len(steps_ns) + 1]


def test_silence_is_longer_the_slower_packets_come_and_ends_a_period_but_not_a_number():
    framing = Framing(period_ns=8 * S)
    assert framing.silence_ns == 8 * S          # no step is known
    stamp_ns = 0
    for steps_ns, expected in (([20 * MS] * 5, S // 2), ([2 * S] * 3, 20 * S)):
        for step_ns in steps_ns:
            stamp_ns += step_ns
            framing.place(stamp_ns)
        assert framing.silence_ns == expected
    framing = Framing(period_ns=100)
    assert framing.flush() is None
    assert frames_of(framing, [0, 20])[0] == [[0, 20]]
    assert (framing.flush(), framing.open, framing.flush()) == ((2, 20), (0, 0), None)
    assert framing.place(40).late and framing.place(120) == Placed()
    counting = Framing(packets=2)
    assert counting.add(0) is None and counting.flush() is None and counting.add(S) == (2, 0)


STREAMS = st.lists(st.integers(0, 4000).map(lambda ms: ms * MS), max_size=80)


@given(stamps=STREAMS, packets=st.integers(1, 5), period=st.sampled_from([0, MS, 7 * MS, 100 * MS]))
@settings(max_examples=200, deadline=None)
def test_whatever_comes_every_packet_is_in_one_frame_or_dropped_for_one_cause(stamps, packets, period):
    frames, dropped = frames_of(Framing(packets, period), stamps)
    assert sorted(sum(frames, sum(dropped.values(), []))) == sorted(stamps)
    assert set(dropped) <= {"late", "incomplete"}
    if period == 0:
        assert all(len(frame) == packets for frame in frames[:-1])
    elif packets > 1:
        assert all(len(frame) <= packets for frame in frames)
