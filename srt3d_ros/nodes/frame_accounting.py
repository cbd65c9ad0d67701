"""Frame accounting: every frame and photon is published, dropped for a named cause, or still in progress."""

import threading
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Balance:
    """An equation of every report: came in = went out + dropped + under way + unaccounted.

    Args:
        what: "frames" (messages, where several make a frame) or "photons".
        out: the total that counts what went out, in whatever was published.
        dropped, under_way: the names under which those are reported.
    """

    what: str
    out: str
    dropped: str
    under_way: str

    @property
    def came_in(self) -> str:
        return f"{self.what}_in"

    @property
    def unaccounted(self) -> str:
        return f"unaccounted_{self.what}"

    def __str__(self) -> str:
        return f"{self.came_in} = {self.out} + {self.dropped} + {self.under_way} + {self.unaccounted}"


FRAMES = Balance("frames", out="frames_out", dropped="dropped", under_way="under_way")
PACKETS = Balance("frames", out="packets", dropped="dropped", under_way="under_way")
PHOTONS = Balance("photons", out="photons", dropped="photons_dropped", under_way="photons_under_way")


class FrameAccounts:
    """Totals, which count from the start and never fall, drops by cause, and whether they balance.

    Every method may be called from any thread.

    Args:
        balances: the equations that the totals keep.
    """

    def __init__(self, balances: Iterable[Balance]):
        self._lock = threading.RLock()
        self._balances = tuple(balances)
        self._totals: Counter[str] = Counter()
        self._unaccounted: Counter[str] = Counter()
        self._drops: dict[str, Counter[str]] = {balance.what: Counter() for balance in self._balances}

    def count(self, **amounts: int) -> None:
        """Add to totals of these names."""
        with self._lock:
            self._totals.update(amounts)

    def drop(self, cause: str, frames: int = 1, photons: int = 0) -> None:
        """Count frames that were dropped for `cause`, and their photons where photons are balanced."""
        with self._lock:
            for what, amount in (("frames", frames), ("photons", photons)):
                if amount and what in self._drops:
                    self._drops[what][cause] += amount

    def audit(self, frames: int, photons: int) -> None:
        """Compare the totals with the frames and photons that wait in queues, while nothing is being processed.

        What came in and is in no total and in no queue is unaccounted for; a negative number was counted twice.
        """
        waiting = {"frames": frames, "photons": photons}
        with self._lock:
            for balance in self._balances:
                self._unaccounted[balance.unaccounted] = self._not_done(balance) - waiting[balance.what]

    def _balanced(self) -> dict[str, int]:
        """All values of the balances but the totals."""
        out: dict[str, int] = {}
        for balance in self._balances:
            drops, missing = self._drops[balance.what], self._unaccounted[balance.unaccounted]
            out |= {balance.dropped: drops.total(), **{f"{balance.dropped}.{cause}": n for cause, n in drops.items()},
                    balance.under_way: self._not_done(balance) - missing, balance.unaccounted: missing}
        return out

    def _not_done(self, balance: Balance) -> int:
        return self._totals[balance.came_in] - self._totals[balance.out] - self._drops[balance.what].total()
