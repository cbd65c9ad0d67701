"""Readers of /diagnostics: the newest reports of the nodes, and what became of a player's frames."""

from collections.abc import Mapping
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray

HARDWARE_ID = "srt3d_ros"
STATUS_LEVELS = ("OK", "WARN", "ERROR", "STALE")        # by number


class Reports(dict[str, Mapping[str, str]]):
    """The newest report of each node of this package, by full name without the leading slash."""

    def add(self, message: DiagnosticArray) -> None:
        """Keep the values of a message's reports, with their `level` and `message`."""
        for status in message.status:
            if status.hardware_id == HARDWARE_ID:
                self[status.name] = {pair.key: pair.value for pair in status.values} | {
                    "level": STATUS_LEVELS[ord(status.level)], "message": status.message}


def in_a_line(reports: list[Mapping[str, str]]) -> str:
    """One line about a pipeline: clouds per second, points, latency, and all that its nodes have dropped."""
    dropped = sum(int(report["dropped"]) + int(report["message_lost"]) for report in reports)
    clouds = next((f"{float(report['rate_out_hz']):.1f} clouds/s, {float(report['points_per_s']):,.0f} points/s, "
                   f"{float(report['latency_p50_ms']):.0f} ms old" for report in reports if "reconstruct_ms" in report),
                  "no clouds yet")
    return f"{clouds}; dropped so far: {dropped}"


class Delivery(NamedTuple):
    """What became of the messages that a player sent.

    Args:
        under_way: messages that may still arrive or become clouds.
        lost: messages lost if nothing more arrives, by place and cause.
        arrived: messages that arrived, by node.
    """

    under_way: int
    lost: dict[str, int]
    arrived: dict[str, int]


class Chain:
    """The nodes behind a player, in the order in which frames pass them, as they report themselves.

    Args:
        names: as in Reports.
    """

    def __init__(self, names: list[str], reports: Reports):
        self._names, self._reports = names, reports
        self._before: dict[str, Mapping[str, str]] = {}

    def missing(self, read_by: str) -> str:
        """The nodes that are not ready, with the reasons; empty if all are.

        Args:
            read_by: names of the player's subscribers, separated by ", ".
        """
        missing = []
        for name in self._names:
            report = self._reports.get(name)
            if report is None:
                missing.append(f"{name} (no report on /diagnostics)")
            elif report["ready"] != "True":
                missing.append(f"{name} ({report.get('waiting_for') or report['message'] or report['state']})")
            elif name not in read_by.split(", "):
                missing.append(f"{name} (not connected to the node before it)")
            read_by = report["read_by"] if report else ""
        return ", ".join(missing)

    def begin(self) -> None:
        """Count from now on."""
        self._before = {name: self._reports[name] for name in self._names}

    def outcome(self, sent: int) -> Delivery:
        """What became of `sent` messages since `begin`."""
        under_way, lost, arrived = 0, {}, {}
        for name in self._names:
            new = self._new(name)
            arrived[name] = new["clouds" if "clouds" in new else "messages_in"]
            if (missing := sent - arrived[name]) > 0:
                lost[f"on the way to {name}"] = missing
                under_way += missing
            if "clouds" not in new:     # in a recorder's counters, clouds are mixed with images and sketches
                lost |= {f"{key.removeprefix('dropped.')} in {name}": count for key, count in new.items()
                         if count and key.startswith("dropped.")}
                if (unfinished := arrived[name] - new.get("packets", new["frames_out"]) - new["dropped"]) > 0:
                    under_way += unfinished
                    lost[f"unfinished in {name}"] = unfinished
            sent = new["frames_out"]
        return Delivery(under_way, lost, arrived)

    def _new(self, name: str) -> dict[str, int]:
        """A node's counters since `begin`."""
        before, report = self._before[name], self._reports[name]
        return {key: int(value) - int(before.get(key, 0)) for key, value in report.items() if value.isdecimal()}
