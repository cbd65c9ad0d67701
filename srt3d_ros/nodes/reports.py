"""What nodes report on /diagnostics, as a reader sees it, and what became of the frames that a player sent."""

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray

HARDWARE_ID = "srt3d_ros"
LEVELS = ("OK", "WARN", "ERROR", "STALE")        # by number


class Reports(dict[str, Mapping[str, str]]):
    """The newest report of each node of this package, by the node's full name without the first slash."""

    def add(self, message: DiagnosticArray) -> None:
        """Take over what a message says; `level` and `message` beside the values."""
        for status in message.status:
            if status.hardware_id == HARDWARE_ID:
                self[status.name] = {pair.key: pair.value for pair in status.values} | {
                    "level": LEVELS[ord(status.level)], "message": status.message}


def in_a_line(reports: list[Mapping[str, str]]) -> str:
    """How a pipeline does: clouds a second, points and latency, and what its nodes have dropped so far."""
    dropped = sum(int(one["dropped"]) + int(one["message_lost"]) for one in reports)
    said = [f"{float(one['rate_out_hz']):.1f} clouds/s, {float(one['points_per_s']):,.0f} points/s, "
            f"{float(one['latency_p50_ms']):.0f} ms old" for one in reports if "reconstruct_ms" in one]
    return f"{(said or ['no clouds yet'])[0]}; dropped so far: {dropped}"


class Chain:
    """The nodes behind a player, in the order in which frames pass them, by their reports.

    Args:
        names: as in Reports.
    """

    def __init__(self, names: list[str], reports: Reports):
        self._names, self._reports = names, reports
        self._before: dict[str, Mapping[str, str]] = {}

    def missing(self, read_by: str) -> str:
        """The nodes that are not ready for frames, each with the reason; `read_by`: who reads what the player sends."""
        said = []
        for name in self._names:
            report = self._reports.get(name)
            if report is None:
                said.append(f"{name} (no report on /diagnostics)")
            elif report["ready"] != "True":
                said.append(f"{name} ({report.get('waiting_for') or report['message'] or report['state']})")
            elif name not in read_by.split(", "):
                said.append(f"{name} (not connected to the node before it)")
            read_by = report["read_by"] if report else ""
        return ", ".join(said)

    def begin(self) -> None:
        """Count from now on."""
        self._before = {name: self._reports[name] for name in self._names}

    def outcome(self, sent: int) -> tuple[int, dict[str, int], dict[str, int]]:
        """Of the messages that the player sent since `begin`: those under way, those lost by where and why, if no more
        comes, and how many came to each node.
        """
        under_way, lost, came = 0, {}, {}
        for name in self._names:
            new = self._new(name)
            came[name] = new["clouds" if "clouds" in new else "messages_in"]
            if (missing := sent - came[name]) > 0:
                lost[f"on the way to {name}"] = missing
                under_way += missing
            if "clouds" not in new:     # a recorder reports itself what it lost beside clouds
                lost |= {f"{key.removeprefix('dropped.')} in {name}": n for key, n in new.items()
                         if n and key.startswith("dropped.")}
                if (unfinished := came[name] - new.get("packets", new["frames_out"]) - new["dropped"]) > 0:
                    under_way += unfinished
                    lost[f"unfinished in {name}"] = unfinished
            sent = new["frames_out"]
        return under_way, lost, came

    def _new(self, name: str) -> dict[str, int]:
        """The counters of a node since `begin`."""
        before, report = self._before[name], self._reports[name]
        return {key: int(value) - int(before.get(key, 0)) for key, value in report.items() if value.isdecimal()}
