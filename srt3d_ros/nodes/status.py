"""NodeStatus: the state of a node as plain data, which /diagnostics carries once a second."""

from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

OK, WARN, ERROR, STALE = LEVELS = ("OK", "WARN", "ERROR", "STALE")     # by number
TEXTS = ("state", "waiting_for", "last_error")
NAMES = ("read_by", "sent_by")


@dataclass(frozen=True)
class NodeStatus:
    """What a node says of itself.

    Args:
        name: full name, without the leading slash.
        level: OK, WARN or ERROR; STALE if its reports have stopped.
        why: the reason for the level, or what the node does, in one line.
        since_s: how long the node has had this level, s.
        state: of its lifecycle, such as active.
        ready: whether it will process every frame that is sent from now on.
        waiting_for: what it waits for; empty: for nothing.
        last_error: the last one, which may be over.
        read_by, sent_by: full names of the nodes that read its frames, and of those that send frames to it.
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
    last_error: str = ""
    read_by: tuple[str, ...] = ()
    sent_by: tuple[str, ...] = ()
    counts: dict[str, int] = field(default_factory=dict)
    facts: dict[str, float | str] = field(default_factory=dict)
    hardware_id: str = ""

    @property
    def failed(self) -> bool:
        """Whether it cannot work, or does not report any more."""
        return self.level in (ERROR, STALE)

    def to_message(self) -> DiagnosticStatus:
        """The status on /diagnostics."""
        values = {"ready": self.ready, "since_s": f"{self.since_s:.1f}"}
        values |= {name: getattr(self, name) for name in TEXTS}
        values |= {name: ", ".join(getattr(self, name)) for name in NAMES} | self.counts | self.facts
        return DiagnosticStatus(name=self.name, level=bytes([LEVELS.index(self.level)]), message=self.why,
                                hardware_id=self.hardware_id,
                                values=[KeyValue(key=key, value=str(value)) for key, value in values.items()])

    @staticmethod
    def from_message(message: DiagnosticStatus) -> "NodeStatus | None":
        """The status in a message; None if it comes from another package."""
        values = {pair.key: pair.value for pair in message.values}
        if not {"ready", "since_s", *TEXTS, *NAMES} <= values.keys():
            return None
        ready, since_s = values.pop("ready") == str(True), float(values.pop("since_s"))
        texts = {name: values.pop(name) for name in TEXTS}
        names = {name: tuple(filter(None, values.pop(name).split(", "))) for name in NAMES}
        counts = {key: int(value) for key, value in values.items() if value.isdecimal()}
        facts = {key: _number_or_text(value) for key, value in values.items() if key not in counts}
        return NodeStatus(message.name, LEVELS[ord(message.level)], message.message, since_s, ready=ready, **texts,
                          **names, counts=counts, facts=facts, hardware_id=message.hardware_id)


def _number_or_text(value: str) -> float | str:
    try:
        return float(value)
    except ValueError:
        return value
