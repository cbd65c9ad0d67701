"""`srt3d health`: a table of the nodes' statuses on /diagnostics."""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import TYPE_CHECKING

from srt3d_ros.processes import transport
from srt3d_ros.processes.node_command import NODES

if TYPE_CHECKING:
    from srt3d_ros.nodes.common.reports import Reports
    from srt3d_ros.nodes.common.status import NodeStatus

HEAR_S = 10.0           # timeout for the first report
ROUND_S = 2.5           # to hear all nodes, which report once a second
POLL_S = 0.1
COLUMNS = {"level": "level", "for s": "since_s", "in/s": "rate_in_hz", "out/s": "rate_out_hz",
           "latency ms": "latency_p50_ms", "dropped": "dropped", "lost": "message_lost", "says": "why"}


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "health",
        description="Print a line for each node: level and since when, messages per second in and out, latency, "
                    "messages dropped and lost since its start, and what it says. STALE: its reports have stopped. "
                    f"Exit code: 1 if a node is ERROR or STALE, or none reports within {HEAR_S:.0f} s.")
    parser.add_argument("--watch", action="store_true", help="repeat until Ctrl-C")
    parser.add_argument("--json", action="store_true", help="print a list of all that the nodes report, as JSON")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    import rclpy  # only here, as it is slow
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.signals import SignalHandlerOptions

    from srt3d_ros.nodes.common.reports import Reports

    transport.reserve_stale_ports()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node, reports = rclpy.create_node(f"srt3d_health_{os.getpid()}", enable_rosout=False), Reports()
    node.create_subscription(DiagnosticArray, "/diagnostics", reports.add, 100)
    while statuses := hear(reports, lambda: rclpy.spin_once(node, timeout_sec=POLL_S)):
        shown = json.dumps([asdict(one) for one in statuses], ensure_ascii=False) if args.json else table(statuses)
        print(shown, end="\n\n" if args.watch and not args.json else "\n", flush=True)
        if not args.watch:
            return int(any(one.failed for one in statuses))
    print(f"srt3d health: no node has reported on /diagnostics for {HEAR_S:.0f} s; ROS_DOMAIN_ID, here "
          f"{os.environ.get('ROS_DOMAIN_ID', 'not set')}, must be that of the nodes", file=sys.stderr)
    return 1


def hear(reports: "Reports", listen: Callable[[], None]) -> list["NodeStatus"]:
    """Listen for a first report, then for those of the other nodes; the statuses, [] if no node reports."""
    end_s = time.monotonic() + HEAR_S
    while not (first := reports.current()) and time.monotonic() < end_s:
        listen()
    end_s = time.monotonic() + ROUND_S
    while first and (time.monotonic() < end_s or not reports.complete):
        listen()
    return reports.current() or first       # all may have ended meanwhile


def table(statuses: Iterable["NodeStatus"]) -> str:
    """The table: a line for each node, in the order in which frames pass them."""
    order = {name: number for number, name in enumerate(NODES)}
    lines = [("node", *COLUMNS)]
    for one in sorted(statuses, key=lambda one: (order.get(one.name.rpartition("/")[2], len(order)), one.name)):
        values = vars(one) | one.counts | one.facts
        lines.append((one.name, *(str(values.get(key, "")) for key in COLUMNS.values())))
    widths = [max(map(len, column)) for column in zip(*lines)]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)
