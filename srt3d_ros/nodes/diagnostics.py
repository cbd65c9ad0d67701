"""/diagnostics of a node, once a second with or without subscribers: counters, rates, latency, last error.

Level, from what happened since the last report:
    ERROR   something failed that should not have, and no frame has left since; the sensor's description cannot be used;
            or more than half of the frames that came in were dropped or lost
    WARN    a frame was dropped or lost, another node has this one's name, several publish its input, the node waits for
            something, or has waited 2 s for a frame, or frames are more than 2 s old when they leave, or stamped ahead
            of the node's clock
    OK      otherwise
"""

import time
from collections import Counter, deque

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from srt3d_ros.core.sketching.counts import Counts
from srt3d_ros.nodes.lifecycle import ManagedNode
from srt3d_ros.nodes.reports import HARDWARE_ID

PERIOD_S = 1.0
LATENCIES_KEPT = 200    # frames over which the percentiles are taken
LAST_REPORT_S = 5.0     # timeout for the last report: one that is lost is sent again with the heartbeat, after 3 s
POLL_S = 0.01
MOST_DROPPED = 0.5      # of the frames since the last report: more is an error
PATIENCE_S = 2.0        # without a frame: a warning
LOG_EVERY_S = 10.0      # what the node waits for
LOG_LOSS_EVERY_S = 60.0     # what was dropped or lost, and what comes twice
DOUBLE_S = 25.0         # of two nodes or publishers: a killed one stays in the graph for 20 s
ENDING = ("inactive", "shutdown")       # causes that are no loss to log
OLD_S = 2.0             # median latency: a warning
# Stamps so far ahead of the clock are a warning. Clocks that NTP keeps differ by milliseconds, but a simulated one may
# tick at only 10 Hz, and be late on a busy machine.
AHEAD_S = 0.5
TOTALS, RATED = ("messages_in", "frames_out", "message_lost", "errors", "internal"), ("photons", "points")


class Diagnostics(Counts):
    """Counts what a node does and reports it. Every method may be called from any thread.

    What came in was published or dropped for a cause once a node has ended.

    Args:
        output: the topic on which the node's frames go out, whose readers it reports.
        best_effort: whether it reads frames so.
    """

    def __init__(self, node: ManagedNode, output: str = "", best_effort: bool = False):
        super().__init__()
        self._unusable = self._warning = self._internal = ""
        self._node, self._output, self._best_effort = node, output, best_effort
        self._latencies_s: deque[float] = deque(maxlen=LATENCIES_KEPT)
        self._values: dict[str, object] = {}
        self._topics: tuple[str, ...] = ()  # on which frames may come
        self._waiting_for = ""              # beside frames
        # When the node began to wait for what is above, for a frame, and for a clock; of time.monotonic().
        self._waiting_since = self._frame_since = self._clock_since = time.monotonic()
        self._last_error = ""
        self._reported = (time.monotonic(), Counter(), Counter())
        self._logged = (-LOG_LOSS_EVERY_S, Counter(), Counter())        # losses
        self._least_latency_s = float("inf")
        self._double_since: float | None = None
        self.publisher = node.create_publisher(DiagnosticArray, "/diagnostics", QoSProfile(depth=10),
                                                qos_overriding_options=QoSOverridingOptions.with_default_policies())
        # a steady clock: reports go on while simulated time stands still
        self._timer = node.create_timer(PERIOD_S, self.report, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def received(self) -> None:
        """Count a frame that came in."""
        self.count(messages_in=1)
        self._frame_since = time.monotonic()

    def expect(self, topic: str) -> None:
        """Expect frames on this topic."""
        self._topics = (*self._topics, topic)
        self._frame_since = time.monotonic()

    def expect_nothing(self) -> None:
        """Expect no frames any more."""
        self._topics = ()

    def wait_for(self, what: str) -> None:
        """Report that the node waits for this, from now on if it is another than before; for nothing if it is empty."""
        if what != self._waiting_for:
            self._waiting_for, self._waiting_since = what, time.monotonic()

    def unusable(self, why: str) -> None:
        """Report as an error why no frame can be used, until this is called with an empty text."""
        self._unusable = why

    def warn(self, text: str) -> None:
        """Report this warning once."""
        self._warning = text

    def sent(self, latency_s: float) -> None:
        """Count a frame that went out `latency_s` after its stamp."""
        with self._lock:
            self.totals["frames_out"] += 1
            self._internal = ""
            self._latencies_s.append(latency_s)
            self._least_latency_s = min(self._least_latency_s, latency_s)

    def error(self, text: str, counted: bool = True) -> None:
        """Keep the last error, and count it unless it is counted elsewhere, such as a malformed message."""
        with self._lock:
            self.totals["errors"] += counted
            self._last_error = text

    def internal(self, text: str) -> None:
        """Count a failure of the node itself, and report it as an error until a frame is sent."""
        with self._lock:
            self.totals["internal"] += 1
            self._internal = text
            self.error(text)

    def show(self, **values: object) -> None:
        """Report these values until they change."""
        with self._lock:
            self._values.update(values)

    def report(self) -> None:
        out = DiagnosticArray()
        out.header.stamp = self._node.get_clock().now().to_msg()
        out.status = [self._status()]
        self.publisher.publish(out)

    def close(self) -> None:
        """Publish the last report and wait until it has arrived."""
        self._timer.cancel()
        self.report()
        self._log_loss(last=True)
        deadline = time.monotonic() + LAST_REPORT_S
        while not all_acknowledged(self.publisher) and time.monotonic() < deadline:
            time.sleep(POLL_S)

    def _status(self) -> DiagnosticStatus:
        with self._lock:
            now = time.monotonic()
            totals, drops = self.totals.copy(), self.dropped.copy()
            since, totals_before, drops_before = self._reported
            new, new_drops = totals - totals_before, drops - drops_before
            self._reported = (now, totals, drops)
            seconds = max(now - since, 1e-3)
            rate_in_hz, rate_out_hz = new["messages_in"] / seconds, new["frames_out"] / seconds
            per_s = {f"{name}_per_s": f"{new[name] / seconds:.1f}" for name in RATED if name in totals}
            values = {"state": self._node.state, **dict.fromkeys(TOTALS, 0), **totals, **_by_cause("dropped", drops),
                      "rate_in_hz": f"{rate_in_hz:.2f}", "rate_out_hz": f"{rate_out_hz:.2f}", **per_s,
                      **self._latency(), **self._values, "last_error": self._last_error, **self._readiness()}
            if "photons_in" in totals:
                values |= _by_cause("photons_dropped", self.photons_dropped)
            waiting_for, since = self._waiting(now)
            if waiting_for:
                values |= {"waiting_for": waiting_for, "waiting_s": f"{now - since:.1f}"}
                waiting_for = f"waiting for {waiting_for} for {now - since:.0f} s"
                if self._node.state == "active" and now - since >= PATIENCE_S:
                    self._node.get_logger().info(waiting_for, throttle_duration_sec=LOG_EVERY_S)
            level, message = self._judge(new, new_drops, waiting_for, self._doubled(now))
            self._log_loss()
            self._warning = ""
            if not message:
                message = f"{rate_in_hz:.1f} frames/s in, {rate_out_hz:.1f} out"
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        return DiagnosticStatus(level=level, name=self._node.get_fully_qualified_name().lstrip("/"), message=message,
                                hardware_id=HARDWARE_ID, values=pairs)

    def _latency(self) -> dict[str, str]:
        """Percentiles of the newest frames' latencies, if there are any."""
        if not self._latencies_s:
            return {}
        p50_ms, p95_ms = np.percentile(self._latencies_s, [50, 95]) * 1e3
        return {"latency_p50_ms": f"{p50_ms:.2f}", "latency_p95_ms": f"{p95_ms:.2f}"}

    def _untimely(self, frames: int) -> str:
        """A warning if the frames sent since the last report were too old or stamped ahead of the clock."""
        newest_s = list(self._latencies_s)[-frames:] if frames else [0.0]
        age_s = float(np.median(newest_s))
        if age_s > OLD_S:
            behind = "behind" if self._least_latency_s < OLD_S else "behind, or stamped by another clock"
            return f"frames are {age_s:.1f} s old: {behind}"
        if age_s < -AHEAD_S:
            return f"frames are stamped {-age_s:.1f} s ahead of this node's clock: by another clock, unknown to tf"
        return ""

    def _waiting(self, now: float) -> tuple[str, float]:
        """What the node waits for, and since when; an empty text if for nothing."""
        if self._node.get_parameter("use_sim_time").value and not self._node.get_clock().now().nanoseconds:
            return "/clock (use_sim_time is true)", self._clock_since
        if self._waiting_for:
            return self._waiting_for, self._waiting_since
        expected = self._topics         # which the worker may empty meanwhile
        if expected and now - self._frame_since > PATIENCE_S:
            publishers = sum(map(self._node.count_publishers, expected))
            *first, last = expected
            topics = f"{', '.join(first)} or {last}" if first else last
            return f"a frame on {topics} (publishers: {publishers})", self._frame_since
        return "", now

    def _readiness(self) -> dict[str, object]:
        """Whether the node makes something of every frame that is sent from now on, and who sends and reads them.

        A reader of best effort gets nothing before it has found the publisher; a reliable one gets it later.
        """
        publishers = [self._node.count_publishers(topic) for topic in tuple(self._topics)]
        connected = all(publishers) or not self._best_effort
        return {"publishers": sum(publishers), "read_by": self.readers(),
                "ready": self._node.state == "active" and connected and not (self._waiting_for or self._unusable)}

    def readers(self) -> str:
        """Who reads the frames that go out, by full names."""
        readers = self._node.get_subscriptions_info_by_topic(self._output) if self._output else ()
        return ", ".join(sorted({f"{one.node_namespace}/{one.node_name}".lstrip("/") for one in readers}))

    def _doubled(self, now: float) -> str:
        """A warning, also logged, if frames may come twice: from nodes of one name, or publishers of one topic."""
        node = self._node
        namesakes = node.get_node_names_and_namespaces().count((node.get_name(), node.get_namespace()))
        counts = [(f"{namesakes} nodes are named {node.get_fully_qualified_name()}", namesakes)]
        counts += [(f"{count} publishers send frames on {topic}", count) for topic in tuple(self._topics)
                   if (count := node.count_publishers(topic)) > 1]
        said = " and ".join(text for text, count in counts if count > 1)
        self._double_since = (self._double_since or now) if said else None
        if not said or now - self._double_since < DOUBLE_S:
            return ""
        node.get_logger().warning(f"{said}: frames may come twice", throttle_duration_sec=LOG_LOSS_EVERY_S)
        return f"{said}: frames may come twice"

    def _log_loss(self, last: bool = False) -> None:
        """Log what was dropped or lost since the last such line: one line a minute at most, and at the end."""
        with self._lock:
            since, totals, drops = self._logged
            new, gone = self.totals - totals, self.dropped - drops
            for cause in ENDING:
                del gone[cause]
            lost = new["message_lost"]
            if (gone or lost) and (last or time.monotonic() - since >= LOG_LOSS_EVERY_S):
                self._logged = time.monotonic(), self.totals.copy(), self.dropped.copy()
                self._node.get_logger().warning(
                    f"dropped {gone.total() + lost} of {new['messages_in'] + lost} frames since "
                    f"{'the last such line' if totals else 'the start'}: {_in_words(new, gone)}")

    def _judge(self, new: Counter, new_drops: Counter, waiting: str, doubled: str) -> tuple[bytes, str]:
        """Level and message; an empty message if nothing is wrong."""
        if new["errors"]:
            return DiagnosticStatus.ERROR, self._last_error
        if self._node.state != "active":
            return DiagnosticStatus.OK, self._node.state
        if self._internal or self._unusable:
            return DiagnosticStatus.ERROR, self._internal or self._unusable
        if new_drops or new["message_lost"]:
            sent, gone = new["messages_in"] + new["message_lost"], new_drops.total() + new["message_lost"]
            level = DiagnosticStatus.ERROR if gone > MOST_DROPPED * sent else DiagnosticStatus.WARN
            return level, f"dropped: {_in_words(new, new_drops)}, of {sent}"
        if doubled:
            return DiagnosticStatus.WARN, doubled
        if self._warning:
            return DiagnosticStatus.WARN, self._warning
        if waiting:
            return DiagnosticStatus.WARN, waiting
        untimely = self._untimely(new["frames_out"])
        return (DiagnosticStatus.WARN, untimely) if untimely else (DiagnosticStatus.OK, "")


def _in_words(totals: Counter, drops: Counter) -> str:
    """What was dropped by the node, and lost before it."""
    lost = totals["message_lost"]
    return ", ".join([f"{n} {cause}" for cause, n in drops.items()] + [f"{lost} lost on the way here"] * (lost > 0))


def _by_cause(name: str, dropped: Counter) -> dict[str, int]:
    """What was dropped, in all and by cause."""
    return {name: dropped.total(), **{f"{name}.{cause}": amount for cause, amount in dropped.items() if amount}}


def all_acknowledged(publisher: Publisher) -> bool:
    """True if every reliable subscriber has what was published. To be polled: rclpy would wait with the GIL held."""
    return publisher.wait_for_all_acked(Duration(seconds=0))
