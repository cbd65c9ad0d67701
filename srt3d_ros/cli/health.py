"""`srt3d health`: a table of the nodes' reports on /diagnostics; also the status line of `srt3d up`."""

import argparse
import os
import sys
import time
from collections.abc import Mapping

from srt3d_ros.processes import transport
from srt3d_ros.processes.node_command import NODES

HEAR_S = 10.0           # timeout for the first report
ROUND_S = 2.5           # to hear all nodes, which report once a second
LINE_S = 5.0            # between status lines of `srt3d up`
COLUMNS = {"level": "level", "in/s": "rate_in_hz", "out/s": "rate_out_hz", "latency ms": "latency_p50_ms",
           "dropped": "dropped", "lost": "message_lost", "says": "message"}


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "health", help="print the state of every node, from /diagnostics",
        description="Print a line for each node: level, frames per second in and out, latency, frames dropped and lost "
                    f"since its start, and its message. Exits with 1 if no node reports within {HEAR_S:.0f} s.")
    parser.add_argument("--watch", action="store_true", help="repeat until Ctrl-C")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    listener = Listener()
    while listener.hear():
        print(table(listener.reports), end="\n\n" if args.watch else "\n", flush=True)
        if not args.watch:
            return 0
        listener.reports.clear()
    print(f"srt3d health: no node has reported on /diagnostics for {HEAR_S:.0f} s; ROS_DOMAIN_ID, here "
          f"{os.environ.get('ROS_DOMAIN_ID', 'not set')}, must be that of the nodes", file=sys.stderr)
    return 1


class Listener:
    """Subscribes to /diagnostics and keeps the newest reports in `reports`."""

    def __init__(self):
        import rclpy  # only here, as it is slow
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.signals import SignalHandlerOptions

        from srt3d_ros.nodes.reports import Reports, in_a_line

        transport.reserve_stale_ports()
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node(f"srt3d_health_{os.getpid()}", enable_rosout=False)
        self.reports, self._in_a_line, self._line_s = Reports(), in_a_line, time.monotonic()
        node.create_subscription(DiagnosticArray, "/diagnostics", self.reports.add, 100)
        self._spin_once = lambda timeout_s: rclpy.spin_once(node, timeout_sec=timeout_s)

    def hear(self) -> bool:
        """Listen for a first report, then for those of the other nodes; False if none arrives."""
        end_s = time.monotonic() + HEAR_S
        while not self.reports and (left_s := end_s - time.monotonic()) > 0:
            self._spin_once(left_s)
        end_s = time.monotonic() + ROUND_S
        while self.reports and (left_s := end_s - time.monotonic()) > 0:
            self._spin_once(left_s)
        return bool(self.reports)

    def print_line(self, names: list[str]) -> None:
        """Print a status line of the named nodes if the last is older than LINE_S; call it often."""
        self._spin_once(0)
        if time.monotonic() - self._line_s > LINE_S:
            self._line_s = time.monotonic()
            print(self._in_a_line([self.reports[name] for name in names if name in self.reports]), flush=True)


def table(reports: Mapping[str, Mapping[str, str]]) -> str:
    """The table: a line for each node, in the order in which frames pass them."""
    order = {name: number for number, name in enumerate(NODES)}
    names = sorted(reports, key=lambda name: order.get(name.rpartition("/")[2], len(order)))
    lines = [("node", *COLUMNS), *((name, *(reports[name].get(key, "") for key in COLUMNS.values())) for name in names)]
    widths = [max(map(len, column)) for column in zip(*lines)]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)
