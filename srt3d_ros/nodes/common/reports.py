"""Readers of /diagnostics: the newest statuses of the nodes, and what became of a player's frames."""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray

from srt3d_ros.nodes.common.status import STALE, NodeStatus
from srt3d_ros.processes.node_command import NODES

STALE_S = 5.0           # without a report, which comes once a second


class Reports(dict[str, NodeStatus]):
    """The newest status of each node of this package, by full name without the leading slash."""

    def __init__(self):
        super().__init__()
        self._heard_s: dict[str, float] = {}    # also of nodes that have not reported: when others first named them

    def add(self, message: DiagnosticArray) -> None:
        """Keep the statuses of a message."""
        now_s = time.monotonic()
        for status in filter(None, map(NodeStatus.from_message, message.status)):
            self[status.name], self._heard_s[status.name] = status, now_s
            for name in (*status.read_by, *status.sent_by):
                if name.rpartition("/")[2] in NODES:
                    self._heard_s.setdefault(name, now_s)

    @property
    def complete(self) -> bool:
        """Whether every node that others name has reported, or is STALE."""
        return all(name in self or time.monotonic() - heard_s >= STALE_S for name, heard_s in self._heard_s.items())

    def current(self) -> list[NodeStatus]:
        """The statuses, STALE those of nodes that have stopped to report; without nodes that have ended in order."""
        now_s, found = time.monotonic(), []
        for name, heard_s in self._heard_s.items():
            status, silent_s = self.get(name, NodeStatus(name, STALE)), now_s - heard_s
            if silent_s >= STALE_S and status.state != "finalized":
                why = f"no report for {silent_s:.0f} s"
                found.append(replace(status, level=STALE, why=why, since_s=round(silent_s, 1), ready=False))
            elif silent_s < STALE_S and name in self:
                found.append(status)
        return found


class Delivery(NamedTuple):
    """What became of the messages that a player sent.

    Args:
        clouds: that the last node has published or recorded.
        missing: messages that are in no cloud.
        under_way: those of them that were not dropped: they may still become clouds.
    """

    clouds: int
    missing: int
    under_way: int


class Chain:
    """The nodes behind a player, in the order in which frames pass them, as they report themselves.

    Args:
        names: as in Reports.
    """

    def __init__(self, names: list[str], reports: Reports):
        self._names, self._reports = names, reports
        self._before: dict[str, dict[str, int]] = {}

    def missing(self, read_by: Sequence[str]) -> str:
        """The nodes that are not ready, with the reasons; empty if all are.

        Args:
            read_by: names of the player's subscribers.
        """
        missing, current = [], {status.name: status for status in self._reports.current()}
        for name in self._names:
            status = current.get(name)
            if status is None:
                missing.append(f"{name} (no report on /diagnostics)")
            elif not status.ready:
                waiting_for = "" if status.failed else status.waiting_for
                missing.append(f"{name} ({waiting_for or status.why})")
            elif name not in read_by:
                missing.append(f"{name} (not connected to the node before it)")
            read_by = status.read_by if status else ()
        return ", ".join(missing)

    def begin(self) -> None:
        """Count from now on."""
        self._before = {name: self._reports[name].counts for name in self._names}

    def outcome(self, sent: int) -> Delivery:
        """What became of `sent` messages since `begin`."""
        clouds, missing, dropped = sent, 0, 0
        for name in self._names:
            counts, before = self._reports[name].counts, self._before[name]
            new = {key: count - before.get(key, 0) for key, count in counts.items()}
            if "clouds" in new:         # of a recorder, whose other counts are of images and sketches, too
                missing, clouds = missing + clouds - new["clouds"], new["clouds"]
            else:                       # a sketcher's frames are of several packets
                missing, clouds = missing + clouds - new.get("packets", new["frames_out"]), new["frames_out"]
                dropped += new["dropped"]
        return Delivery(clouds, missing, missing - dropped)
