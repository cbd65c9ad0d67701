"""Diagnostics: a node's NodeStatus on /diagnostics, once a second.

The level depends on what happened since the last report, and on what still holds:
    ERROR   the node failed or cannot work, and has sent no frame since; or an error was counted; or more than half of
            the messages were dropped or lost
    WARN    a message was dropped or lost; the node works, but not as asked (`degrade`); photons look wrong (`warn`);
            it waits for something, or has waited 2 s for a frame; or frames leave over 2 s late, or have stamps in the
            future
    OK      otherwise
"""

import time
import traceback
from collections import Counter

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from srt3d_ros.core.stream import Counts
from srt3d_ros.errors import InvalidInput
from srt3d_ros.nodes.common import peers
from srt3d_ros.nodes.common.latencies import Latencies
from srt3d_ros.nodes.common.status import ERROR, OK, WARN, NodeStatus
from srt3d_ros.nodes.common.worker import Dropped

PERIOD_S = 1.0
LAST_REPORT_S = 5.0     # timeout for the last report: DDS sends a lost one again after its heartbeat of 3 s
POLL_READERS_S = 0.01
MOST_DROPPED = 0.5      # share of the frames since the last report; more is an error
PATIENCE_S = 2.0        # without a frame before a warning
WAITING_EVERY_S = 10.0      # at most, a line about what the node waits for
LOG_EVERY_S = 2.0           # at most, a line about the same failure: rclpy limits lines by their place in the source
LOG_LOSS_EVERY_S = 60.0     # at most, a line about losses
ENDING = ("inactive", "shutdown")       # causes of drops that are not logged
TOTALS, RATED = ("messages_in", "frames_out", "message_lost", "errors", "internal"), ("photons", "points")


class Diagnostics(Counts):
    """Counts a node's messages, frames and errors, and reports them. Any thread may call any method.

    At shutdown, received = published + dropped.

    Args:
        best_effort: whether the node subscribes to frames with best effort.

    Attributes:
        state: of the node's lifecycle.
        output: the topic of the node's frames, whose readers are reported.
        problem: why the node cannot work: an error until it is set to "", or a frame is sent.
        frame_id: of the sensor, once it is known.
        waiting_for: what the node waits for, if not for a frame.
        topics: on which the node receives frames.
    """

    def __init__(self, node: Node, output: str = "", best_effort: bool = False):
        super().__init__()
        self.state = "unconfigured"
        self.problem = self.frame_id = self._warning = self._internal = ""
        self._degraded: dict[str, str] = {}     # by cause
        self._node, self._log, self.output, self._best_effort = node, node.get_logger(), output, best_effort
        self._latencies = Latencies()
        self._values: dict[str, object] = {}
        self.topics: tuple[str, ...] = ()
        self.waiting_for = self._waiting_on = ""       # something else than a frame, and its topic
        self._waiting_since = self._frame_since = self._level_since = time.monotonic()
        self._clock_since: float | None = None          # when the node began to wait for /clock
        self._level, self._last_error = OK, ""
        self._reported = (time.monotonic(), Counter(), Counter())
        self._logged = (-LOG_LOSS_EVERY_S, Counter(), Counter())        # losses
        self._raised_at: set[tuple] = set()     # places of bugs whose traceback has been logged
        self.publisher = node.create_publisher(DiagnosticArray, "/diagnostics", QoSProfile(depth=10),
                                                qos_overriding_options=QoSOverridingOptions.with_default_policies())
        # A steady clock, so that reports go on while simulated time stands still.
        self._timer = node.create_timer(PERIOD_S, self.report, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def received(self, lost: int = 0) -> None:
        """Count a frame that arrived, and those that were lost before it."""
        self.count(messages_in=1, message_lost=lost)
        self._frame_since = time.monotonic()

    def expect(self, topic: str) -> None:
        """Expect frames on this topic."""
        self.topics = (*self.topics, topic)
        self._frame_since = time.monotonic()

    def wait_for(self, what: str, topic: str = "") -> None:
        """Report that the node waits for `what`, on this topic if one is given; an empty text: for nothing."""
        if what != self.waiting_for:
            self.waiting_for, self._waiting_on, self._waiting_since = what, topic, time.monotonic()

    def warn(self, text: str) -> None:
        """Show a warning in the next report only."""
        self._warning = text

    def sent(self, latency_s: float) -> None:
        """Count a frame that was published `latency_s` after its stamp."""
        with self._lock:
            self.totals["frames_out"] += 1
            self.clear()
            self._latencies.add(latency_s)

    def error(self, text: str, counted: bool = True) -> None:
        """Show the text as the last error; `counted`: count it as an error, too."""
        with self._lock:
            if counted:
                self.totals["errors"] += 1
            self._last_error = text

    def degrade(self, cause: str, text: str) -> bool:
        """Warn of what the node does not do as asked, by cause, until `text` is ""; whether that begins or ends now."""
        with self._lock:
            changed = (cause in self._degraded) != bool(text)
            if text:
                self._degraded[cause] = text
            else:
                self._degraded.pop(cause, None)
            return changed

    def begin(self) -> None:
        """Report nothing of former activations."""
        with self._lock:
            self._degraded.clear()
        self.clear()

    def clear(self) -> None:
        """Report no problem and no bug any more."""
        self.problem = self._internal = ""

    def failed(self, error: Exception, frames: int = 0) -> None:
        """Log what a callback or a job raised, and count it and the frames that it cost."""
        if isinstance(error, Dropped):
            self.drop(error.cause, frames)
            self._log.warning(f"frame dropped: {error}", throttle_duration_sec=LOG_EVERY_S)
        elif not isinstance(error, InvalidInput):
            self.drop("internal", frames)
            self._add_bug(error)
        elif frames:
            self.error(str(error), counted=False)
            self.drop("malformed", frames)
            self._log.warning(f"frame dropped: {error}", throttle_duration_sec=LOG_EVERY_S)
        else:
            self.error(str(error))
            self._log.error(str(error), throttle_duration_sec=LOG_EVERY_S)

    def _add_bug(self, error: Exception) -> None:
        """Report a bug of this package until a frame is sent or the node is activated again; log its traceback once."""
        text = f"{type(error).__name__}: {' '.join(str(error).split())}"
        with self._lock:
            self.totals["internal"] += 1
            self._internal = text
            self.error(text)
        raised_at = tuple((part.filename, part.lineno) for part in traceback.extract_tb(error.__traceback__))
        if raised_at in self._raised_at:
            self._log.error(f"again: {text}", throttle_duration_sec=LOG_EVERY_S)
        else:
            self._raised_at.add(raised_at)
            self._log.error("".join(traceback.format_exception(error)).rstrip())

    def show(self, **values: object) -> None:
        """Show these values in all reports from now on."""
        with self._lock:
            self._values.update(values)

    def report(self) -> None:
        out = DiagnosticArray()
        out.header.stamp = self._node.get_clock().now().to_msg()
        out.status = [self._status().to_message()]
        self.publisher.publish(out)

    def close(self) -> None:
        """Publish the last report and wait until the readers have it."""
        self._timer.cancel()
        self.report()
        self._log_loss(last=True)
        deadline = time.monotonic() + LAST_REPORT_S
        while not peers.all_acknowledged(self.publisher) and time.monotonic() < deadline:
            time.sleep(POLL_READERS_S)

    def _status(self) -> NodeStatus:
        with self._lock:
            now = time.monotonic()
            totals, drops = self.totals.copy(), self.dropped.copy()
            since, totals_before, drops_before = self._reported
            new, new_drops = totals - totals_before, drops - drops_before
            self._reported = (now, totals, drops)
            seconds = max(now - since, 1e-3)
            rate_in_hz, rate_out_hz = new["messages_in"] / seconds, new["frames_out"] / seconds
            counts = {**dict.fromkeys(TOTALS, 0), **totals, **_by_cause("dropped", drops)}
            if "photons_in" in totals:
                counts |= _by_cause("photons_dropped", self.photons_dropped)
            facts = {"rate_in_hz": f"{rate_in_hz:.2f}", "rate_out_hz": f"{rate_out_hz:.2f}",
                     **{f"{name}_per_s": f"{new[name] / seconds:.1f}" for name in RATED if name in totals},
                     **self._latencies.percentiles(), **self._values, "last_error": self._last_error}
            waiting_for, since = self._waiting(now)
            waiting = ""
            if waiting_for:
                facts["waiting_s"] = f"{now - since:.1f}"
                waiting = f"waiting for {waiting_for} for {now - since:.0f} s"
                if self.state == "active" and now - since >= PATIENCE_S:
                    self._log.info(waiting, throttle_duration_sec=WAITING_EVERY_S)
            level, why = self._judge(new, new_drops, waiting)
            if level != self._level:
                self._level, self._level_since = level, now
            self._log_loss()
            self._warning = ""
        hardware = filter(None, (self._node.get_namespace().strip("/"), self.frame_id))
        return NodeStatus(
            self._node.get_fully_qualified_name().lstrip("/"), level,
            why or f"{rate_in_hz:.1f} messages/s in, {rate_out_hz:.1f} out", now - self._level_since, self.state,
            self._is_ready(), waiting_for, self.readers(),
            peers.names(peers.publishers(self._node, self.topics)), counts, facts, "/".join(hardware))

    def _waiting(self, now: float) -> tuple[str, float]:
        """What the node waits for, and since when; an empty text: for nothing."""
        if self._node.get_parameter("use_sim_time").value and not self._node.get_clock().now().nanoseconds:
            self._clock_since = self._clock_since or now
            return "/clock (use_sim_time is true)", self._clock_since
        self._clock_since = None
        if what := self.waiting_for:
            on = self._waiting_on
            return f"{what} on {peers.in_words(self._node, [on])}" if on else what, self._waiting_since
        expected = self.topics         # the worker may replace it at any time
        if expected and now - self._frame_since > PATIENCE_S:
            return f"a frame on {peers.in_words(self._node, expected)}", self._frame_since
        return "", now

    def _is_ready(self) -> bool:
        """Whether the node will process every frame that is sent from now on.

        A best-effort reader misses frames until it has discovered the publisher; a reliable one gets them later.
        """
        connected = not self._best_effort or all(map(self._node.count_publishers, self.topics))
        return self.state == "active" and connected and not (self.waiting_for or self.problem)

    def readers(self) -> tuple[str, ...]:
        """Full names of the nodes that read the published frames."""
        return peers.names(peers.readers(self._node, [self.output] if self.output else []))

    def _log_loss(self, last: bool = False) -> None:
        """Log the losses since the last such line: at most once a minute, and at the end."""
        with self._lock:
            since, totals, drops = self._logged
            new, gone = self.totals - totals, self.dropped - drops
            for cause in ENDING:
                del gone[cause]
            lost = new["message_lost"]
            if (gone or lost) and (last or time.monotonic() - since >= LOG_LOSS_EVERY_S):
                self._logged = time.monotonic(), self.totals.copy(), self.dropped.copy()
                self._log.warning(
                    f"dropped {gone.total() + lost} of {new['messages_in'] + lost} messages since "
                    f"{'the last such line' if totals else 'the start'}: {_losses_text(new, gone)}")

    def _judge(self, new: Counter, new_drops: Counter, waiting: str) -> tuple[str, str]:
        """The level of a report and the reason; the reason is empty if all is well."""
        problem = self.problem or self._internal
        if problem and self.state in ("active", "finalized"):
            return ERROR, problem
        if new["errors"]:
            return ERROR, self._last_error
        if self.state != "active":
            return OK, self.state
        if new_drops or new["message_lost"]:
            sent, gone = new["messages_in"] + new["message_lost"], new_drops.total() + new["message_lost"]
            why = f"dropped: {_losses_text(new, new_drops)}, of {sent}{waiting and f'; {waiting}'}"
            return ERROR if gone > MOST_DROPPED * sent else WARN, why
        degraded, untimely = "; ".join(self._degraded.values()), self._latencies.untimely(new["frames_out"])
        warning = waiting or degraded or self._warning or untimely
        return (WARN, warning) if warning else (OK, "")


def _losses_text(totals: Counter, drops: Counter) -> str:
    """The frames that the node dropped, by cause, and those lost before they reached it."""
    losses = [f"{frames} {cause}" for cause, frames in drops.items()]
    if totals["message_lost"] > 0:
        losses.append(f"{totals['message_lost']} lost on the way here")
    return ", ".join(losses)


def _by_cause(name: str, dropped: Counter) -> dict[str, int]:
    """The values of a report for drops: the sum, and each cause."""
    return {name: dropped.total(), **{f"{name}.{cause}": amount for cause, amount in dropped.items() if amount}}
