"""Progress that is not shown, and a plan that takes no time."""

import pytest

from srt3d_ros.benchmark.plan import Plan


class SilentBar:
    """Remembers what a Progress would show."""

    def __init__(self):
        self.shown, self.notes = [], []
        self.show, self.note = self.shown.append, self.notes.append


@pytest.fixture
def bar() -> SilentBar:
    return SilentBar()


@pytest.fixture
def tiny() -> Plan:
    """Frames of 12 × 12 and 16 × 16 pixels, two repeats."""
    return Plan(repeats=2, sides=(12, 16), side=12, ppps=(1, 10), dense_ppps=(5, 20), cycles=40)
