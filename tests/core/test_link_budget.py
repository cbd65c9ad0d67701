"""Links and readers of any speed, simulated: what LinkBudget sends over them, and when."""

import pytest

from srt3d_ros.core import link_budget
from srt3d_ros.core.link_budget import COARSEST, LIMIT, READERS, LinkBudget

STEP, PERIOD_S, BYTES = 0.4, 1 / 30, 180_000        # 141 × 141 pixels, m = 10, 10 photons per pixel
TICK_S = 0.001
HEARTBEATS_S = 0.01     # until an arrival is acknowledged


class Link:
    """Frames of a sensor over a link: what was sent when, of how many frames, at which step, when it arrived."""

    def __init__(self, budget: LinkBudget, period_s: float = PERIOD_S, size: float = BYTES):
        self.budget, self._period_s, self._size = budget, period_s, size
        self.sent: list[tuple[float, int, float, float]] = []
        self._waiting, self._now_s, self._next_s = [], 0.0, period_s
        self.bytes = 0

    def run(self, seconds: float, mbit_s: float) -> list[tuple[float, int, float, float]]:
        """(age of the first photon on arrival, frames, step, time of arrival) of what is sent in so many seconds."""
        first, end_s = len(self.sent), self._now_s + seconds
        while self._now_s < end_s:
            self._now_s += TICK_S
            if self._now_s >= self._next_s:
                self._waiting.append(self._next_s - self._period_s)
                self._next_s += self._period_s
            arrived_s = self.sent[-1][3] if self.sent else 0.0
            if self._waiting and not self.budget.must_wait(self._now_s, self._now_s >= arrived_s + HEARTBEATS_S):
                step = self.budget.step
                size = round(self._size * (STEP / step) ** 0.5) if step else self._size      # about
                done_s = max(arrived_s, self._now_s) + size * 8e-6 / mbit_s
                self.sent.append((done_s - self._waiting[0], len(self._waiting), step, done_s))
                self.bytes += size
                self.budget.sent(self._now_s, size, len(self._waiting))
                self._waiting.clear()
        return self.sent[first:]


def test_a_link_that_keeps_up_gets_every_frame_as_it_is():
    link = Link(LinkBudget(100, STEP))
    sent = link.run(10, mbit_s=100)
    assert len(sent) >= 299 and {(frames, step) for _, frames, step, _ in sent} == {(1, STEP)}
    assert not link.budget.why and link.budget.mbit_s == pytest.approx(BYTES * 30 * 8e-6, rel=0.05)


def test_a_busy_machine_that_is_late_now_and_then_coarsens_nothing():
    budget = LinkBudget(100, STEP)
    for k in range(300):
        budget.sent(k * PERIOD_S, BYTES, 2 if k % 12 == 0 else 1)
    assert budget.step == STEP and not budget.why


def test_a_link_that_slows_down_makes_no_frame_old_and_all_is_well_again_when_it_is_fast():
    link = Link(LinkBudget(100, STEP))
    link.run(5, mbit_s=100)
    slow = link.run(10, mbit_s=10)
    assert max(age_s for age_s, *_ in slow) < 0.5
    assert link.budget.why == READERS and slow[-1][2] == COARSEST
    assert sum(frames for _, frames, *_ in slow) >= 295         # merged, not dropped
    link.run(12, mbit_s=100)
    assert not link.budget.why
    assert {(frames, step) for _, frames, step, _ in link.run(2, mbit_s=100)} == {(1, STEP)}


@pytest.mark.parametrize("limit_mbit_s", [4, 25, 40])
def test_the_mean_stays_below_the_limit_and_near_it(limit_mbit_s):
    link = Link(LinkBudget(limit_mbit_s, STEP))
    link.run(20, mbit_s=1000)
    mbit_s = link.bytes * 8e-6 / 20
    assert 0.6 * limit_mbit_s < mbit_s < 1.02 * limit_mbit_s
    assert link.budget.why == (LIMIT if limit_mbit_s < 40 else "")      # 7 % too much: a frame is merged now and then
    # 25 Mbit/s carry one step and not the next finer one: no frame is merged to find out
    assert limit_mbit_s != 25 or max(frames for _, frames, *_ in link.run(20, mbit_s=1000)) == 1


def test_without_coding_frames_are_merged_and_the_step_stays_0():
    sent = Link(LinkBudget(1000, 0.0)).run(5, mbit_s=10)
    assert {step for _, _, step, _ in sent} == {0.0} and 4 <= sent[-1][1] <= 8
    coarse = Link(LinkBudget(10, 2.0)).run(5, mbit_s=10)                    # set beyond the coarsest: it stays, too
    assert {step for _, _, step, _ in coarse} == {2.0}


def test_a_reader_that_is_gone_holds_up_the_others_for_a_bounded_time():
    budget = LinkBudget(100, STEP)
    budget.sent(0, BYTES, 1)
    assert budget.must_wait(link_budget.MAX_WAIT_S - 0.01, False)
    assert not budget.must_wait(link_budget.MAX_WAIT_S, False)


@pytest.mark.parametrize(("size", "sketches"), [(link_budget.FREE_BYTES // 2, 3), (1000, link_budget.FREE_SKETCHES)])
def test_small_sketches_wait_for_no_acknowledgement_until_there_are_many(size, sketches):
    budget = LinkBudget(100, STEP)
    for k in range(sketches):
        assert not budget.must_wait(k * 0.01, False)
        budget.sent(k * 0.01, size, 1)
    assert budget.must_wait(0.04, False) and not budget.must_wait(0.04, True)
