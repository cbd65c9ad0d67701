"""/diagnostics of a node, once a second with or without subscribers: frame accounting, rates, latency, last error.

Level, from what happened since the last report:
    ERROR   something failed that should not have, frame accounting does not add up, inputs contradict each other, or
            more than half of the frames that came in were dropped or lost
    WARN    a frame was dropped or lost, time is simulated and there is no clock, the node waits for something, no frame
            came for 2 s, frames are more than 2 s old when they leave, or stamped ahead of the node's clock, or are
            degraded
    OK      otherwise
"""

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from srt3d_ros.nodes.frame_accounting import FRAMES, Balance, FrameAccounts
from srt3d_ros.nodes.lifecycle import ManagedNode

PIPELINE_ID = "srt3d_ros"     # hardware_id of these nodes, by which they recognise each other's reports
PERIOD_S = 1.0
LATENCIES_KEPT = 200    # frames over which the percentiles are taken
LAST_REPORT_S = 2.0     # timeout for the last report to reach the subscribers
POLL_S = 0.01
MOST_DROPPED = 0.5      # of the frames since the last report: more is an error
SILENCE_S = 2.0         # without a frame: a warning
OLD_S = 2.0             # median latency: a warning
# Stamps so far ahead of the clock are a warning. Clocks that NTP keeps differ by milliseconds, but a simulated one may
# tick at only 10 Hz, and be late on a busy machine.
AHEAD_S = 0.5
STEADY = ("frames_in", "frames_out", "message_lost", "errors")      # totals that need no rate of their own


class Diagnostics(FrameAccounts):
    """Counts what a node does and reports it.

    Attributes:
        find_contradiction: called at each report; the text that it returns, unless empty, is an error. It must not call
            these diagnostics.
        find_warning: likewise for a warning.
        waiting_for: what the node waits for; empty if for nothing.
        degraded: how frames are degraded; empty if they are not.
    """

    def __init__(self, node: ManagedNode, balances: Iterable[Balance] = (FRAMES,)):
        super().__init__(balances)
        self.find_contradiction: Callable[[], str] = str
        self.find_warning: Callable[[], str] = str
        self._node = node
        self._latencies_s: deque[float] = deque(maxlen=LATENCIES_KEPT)
        self._values: dict[str, object] = {}
        self.waiting_for = self.degraded = ""
        self._topics: dict[str, str] = {}   # on which frames may come, and of what type
        self._silent_since = 0.0            # when the last frame came in, or frames were first expected
        self._any_frame = False             # whether one has come since then
        self._last_error = ""
        self._reported = (time.monotonic(), Counter(), Counter(), Counter())
        self.publisher = node.create_publisher(DiagnosticArray, "/diagnostics", QoSProfile(depth=10),
                                                qos_overriding_options=QoSOverridingOptions.with_default_policies())
        # a steady clock: reports go on while simulated time stands still
        self._timer = node.create_timer(PERIOD_S, self.report, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def received(self, photons: int = 0) -> None:
        """Count a frame that came in and announces so many photons."""
        self.count(frames_in=1, **({"photons_in": photons} if photons else {}))
        self._silent_since, self._any_frame = time.monotonic(), True

    def expect(self, topic: str, type_name: str) -> None:
        """Expect frames of this type on this topic."""
        self._topics[topic] = type_name
        self._silent_since, self._any_frame = time.monotonic(), False

    def expect_nothing(self) -> None:
        """Expect no frames any more."""
        self._topics.clear()

    def sent(self, latency_s: float, **amounts: int) -> None:
        """Count a frame that went out `latency_s` after its stamp, and add to totals of these names."""
        with self._lock:
            self._totals.update(amounts, frames_out=1)
            self._latencies_s.append(latency_s)

    def error(self, text: str, counted: bool = True) -> None:
        """Keep the last error, and count it unless it is counted elsewhere, such as a malformed message."""
        with self._lock:
            self._totals["errors"] += counted
            self._last_error = text

    def show(self, **values: object) -> None:
        """Report these values until they change."""
        with self._lock:
            self._values.update(values)

    def report(self) -> None:
        """Publish a report now."""
        out = DiagnosticArray()
        out.header.stamp = self._node.get_clock().now().to_msg()
        out.status = [self._status()]
        self.publisher.publish(out)

    def close(self) -> None:
        """Publish the last report and wait until it has arrived."""
        self._timer.cancel()
        self.report()
        deadline = time.monotonic() + LAST_REPORT_S
        while not all_acknowledged(self.publisher) and time.monotonic() < deadline:
            time.sleep(POLL_S)

    def _status(self) -> DiagnosticStatus:
        with self._lock:
            now = time.monotonic()
            totals, drops, unaccounted = (
                counts.copy() for counts in (self._totals, self._drops["frames"], self._unaccounted))
            since, totals_before, drops_before, unaccounted_before = self._reported
            new, new_drops = totals - totals_before, drops - drops_before
            self._reported = (now, totals, drops, unaccounted)
            seconds = max(now - since, 1e-3)
            rate_in_hz, rate_out_hz = new["frames_in"] / seconds, new["frames_out"] / seconds
            per_s = {f"{name}_per_s": f"{new[name] / seconds:.1f}" for name in totals if name not in STEADY}
            values = {"state": self._node.state, **dict.fromkeys(STEADY, 0), **totals, **per_s,
                      **self._balanced(),
                      "rate_in_hz": f"{rate_in_hz:.2f}", "rate_out_hz": f"{rate_out_hz:.2f}",
                      **self._latency(), **self._values, "last_error": self._last_error}
            missing = unaccounted if unaccounted != unaccounted_before else Counter()
            level, message = self._judge(new, new_drops, missing, now)
            if not message:
                message = f"{rate_in_hz:.1f} frames/s in, {rate_out_hz:.1f} out"
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        return DiagnosticStatus(level=level, name=self._node.get_fully_qualified_name().lstrip("/"), message=message,
                                hardware_id=PIPELINE_ID, values=pairs)

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
            return f"frames are {age_s:.1f} s old: behind, or stamped by another clock"
        if age_s < -AHEAD_S:
            return f"frames are stamped {-age_s:.1f} s ahead of this node's clock: by another clock, unknown to tf"
        return ""

    def _missing_clock(self) -> str:
        """A warning if time is simulated and there is no clock."""
        if not self._node.get_parameter("use_sim_time").value:
            return ""
        clock = self._publishers("/clock", "rosgraph_msgs/msg/Clock")
        if clock.startswith("nobody"):
            return f"use_sim_time is true, but {clock}"
        return "" if self._node.get_clock().now().nanoseconds else (
            f"use_sim_time is true and {clock}, but the clock stands at 0")

    def _silence(self, seconds: float) -> str:
        """For how long no frame has come, or who could send one."""
        if self._any_frame:
            return f"no frame for {seconds:.0f} s"
        return "no frame yet: " + ", ".join(self._publishers(topic, wanted) for topic, wanted in self._topics.items())

    def _publishers(self, topic: str, wanted: str) -> str:
        """Who publishes on a topic. A publisher of another type than `wanted` never reaches this node."""
        types = Counter(publisher.topic_type for publisher in self._node.get_publishers_info_by_topic(topic))
        count = types.pop(wanted, 0)
        words = f"{count} publish {topic}" if count > 1 else f"{count or 'nobody'} publishes {topic}"
        return words + (f" (but there is {', '.join(types)}: expected {wanted})" if types else "")

    def _judge(self, new: Counter, new_drops: Counter, missing: Counter, now: float) -> tuple[bytes, str]:
        """Level and message; an empty message if nothing is wrong."""
        if new["errors"]:
            return DiagnosticStatus.ERROR, self._last_error
        if any(missing.values()):
            return DiagnosticStatus.ERROR, "frame accounting does not add up: " + ", ".join(
                f"{name} {amount}" for name, amount in missing.items() if amount)
        if self._node.state != "active":
            return DiagnosticStatus.OK, self._node.state
        if contradiction := self.find_contradiction():
            return DiagnosticStatus.ERROR, contradiction
        if new_drops or new["message_lost"]:
            sent, gone = new["frames_in"] + new["message_lost"], new_drops.total() + new["message_lost"]
            causes = [f"{n} {cause}" for cause, n in new_drops.items()]
            if new["message_lost"]:
                causes.append(f"{new['message_lost']} lost on the way here")
            level = DiagnosticStatus.ERROR if gone > MOST_DROPPED * sent else DiagnosticStatus.WARN
            several = "".join(f"; {count} publish {topic}" for topic in self._topics
                              if (count := self._node.count_publishers(topic)) > 1)
            return level, f"dropped: {', '.join(causes)}, of {sent}{several}"
        if warning := self.find_warning():
            return DiagnosticStatus.WARN, warning
        if no_clock := self._missing_clock():
            return DiagnosticStatus.WARN, no_clock
        if self.waiting_for:
            return DiagnosticStatus.WARN, f"waiting for {self.waiting_for}"
        if self._topics and now - self._silent_since > SILENCE_S:
            return DiagnosticStatus.WARN, self._silence(now - self._silent_since)
        if untimely := self._untimely(new["frames_out"]):
            return DiagnosticStatus.WARN, untimely
        return (DiagnosticStatus.WARN, self.degraded) if self.degraded else (DiagnosticStatus.OK, "")


def all_acknowledged(publisher: Publisher) -> bool:
    """True if every reliable subscriber has what was published. To be polled: rclpy would wait with the GIL held."""
    return publisher.wait_for_all_acked(Duration(seconds=0))
