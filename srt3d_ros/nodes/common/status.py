"""NodeStatus: the state of a node as plain data, which /diagnostics carries once a second."""

from contextlib import suppress
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

OK, WARN, ERROR, STALE = LEVELS = ("OK", "WARN", "ERROR", "STALE")     # by number


@dataclass(frozen=True)
class NodeStatus:
    """What a node says of itself.

    Args:
        name: full name, without the leading slash; so are those in `read_by` and `sent_by`.
        level: OK, WARN or ERROR; STALE if its reports have stopped.
        why: the reason for the level, or what the node does.
        since_s: how long the node has had this level, s.
        state: of its lifecycle, such as active.
        ready: whether it will process every frame that is sent from now on.
        counts: whole numbers: totals since its start, and sizes.
        facts: all else, such as rates and latencies.
        hardware_id: the node's namespace and its sensor's frame in tf, such as left/spad_optical.
    """

    name: str
    level: str
    why: str = ""
    since_s: float = 0.0
    state: str = ""
    ready: bool = False
    waiting_for: str = ""
    read_by: tuple[str, ...] = ()
    sent_by: tuple[str, ...] = ()
    counts: dict[str, int] = field(default_factory=dict)
    facts: dict[str, float | str] = field(default_factory=dict)
    hardware_id: str = ""

    @property
    def failed(self) -> bool:
        return self.level in (ERROR, STALE)

    def to_message(self) -> DiagnosticStatus:
        values = {"state": self.state, "ready": self.ready, "since_s": f"{self.since_s:.1f}",
                  "waiting_for": self.waiting_for, "read_by": ", ".join(self.read_by),
                  "sent_by": ", ".join(self.sent_by), **self.counts, **self.facts}
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        return DiagnosticStatus(level=bytes([LEVELS.index(self.level)]), name=self.name, message=self.why,
                                hardware_id=self.hardware_id, values=pairs)

    @staticmethod
    def from_message(message: DiagnosticStatus) -> "NodeStatus | None":
        """The status in a message; None if another package reports it."""
        values = {pair.key: pair.value for pair in message.values}
        try:
            level, since_s, ready = LEVELS[ord(message.level)], float(values.pop("since_s")), values.pop("ready")
        except (IndexError, KeyError, ValueError):
            return None
        read_by, sent_by = (tuple(filter(None, values.pop(key, "").split(", "))) for key in ("read_by", "sent_by"))
        status = NodeStatus(message.name, level, message.message, since_s, values.pop("state", ""), ready == "True",
                            values.pop("waiting_for", ""), read_by, sent_by, hardware_id=message.hardware_id)
        for key, value in values.items():
            if value.isdecimal():
                status.counts[key] = int(value)
            else:
                status.facts[key] = value
                with suppress(ValueError):
                    status.facts[key] = float(value)
        return status
