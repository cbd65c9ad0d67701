"""A bar that is not drawn, and plans that take no time."""

import pytest

from srt3d_ros.benchmark.plan import Plan


class SilentBar:
    """Remembers what a Progress would show."""

    def __init__(self):
        self.n, self.shown = 0, []

    def show(self, activity: str) -> None:
        self.shown.append(activity)

    def update(self, n: int = 1) -> None:
        self.n += n


@pytest.fixture
def bar() -> SilentBar:
    return SilentBar()


@pytest.fixture
def notes() -> list[str]:
    return []


@pytest.fixture
def tiny() -> Plan:
    """Frames of 12 × 12 and 16 × 16 pixels, two repeats."""
    return Plan(repeats=2, sides=(12, 16), side=12, ppps=(1, 10), dense_ppps=(5, 20), cycles=40)
