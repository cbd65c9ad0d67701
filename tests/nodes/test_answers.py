"""How many messages a lossless player may send before clouds answer them."""

from srt3d_ros.nodes.answers import MORE_BYTES, Answers


def send_all(answers: Answers, stamp_ns: int, size: int = 1) -> int:
    """Send while there is room; the next stamp."""
    while answers.has_room:
        answers.sent(stamp_ns, size)
        stamp_ns += 1
    return stamp_ns


def test_as_many_messages_as_in_flight_may_be_unanswered_and_more_only_while_nothing_is_answered():
    answers = Answers(in_flight=2, per_frame=1)
    assert send_all(answers, 0) == 2
    answers.answered(0)
    assert send_all(answers, 2) == 3
    answers.silent()
    assert send_all(answers, 3) == 5 and answers.silences == 1
    answers.answered(1)
    assert not answers.has_room and answers.silences == 0


def test_frames_of_several_messages_are_learned_and_two_of_them_sent():
    answers = Answers(in_flight=2, per_frame=1)
    send_all(answers, 0)
    for _ in range(3):
        answers.silent()
    assert send_all(answers, 2) == 8
    answers.answered(0)             # a frame of three has the stamp of its first
    answers.answered(3)
    assert answers.per_frame == 3 and answers.unanswerable == 4
    assert send_all(answers, 8) == 4 + 6
    answers.clear()
    assert len(answers) == 0 and send_all(answers, 0) == 6


def test_large_messages_are_no_more_than_in_flight_however_long_nothing_is_answered():
    answers = Answers(in_flight=2, per_frame=1)
    stamp_ns = send_all(answers, 0, MORE_BYTES // 2)
    for _ in range(5):
        answers.silent()
    assert send_all(answers, stamp_ns) == 2 and answers.silences == 5
