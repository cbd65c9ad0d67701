"""`srt3d review`: the content of a recording in figures and as a report, without a viewer."""

import argparse
import json
from pathlib import Path

from srt3d_ros.cli import common


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "review",
        description="Print the figures of a recording (.rrd) and write a report with pictures and plots that opens in "
                    "any browser.")
    parser.add_argument("recording", metavar="RECORDING", type=Path, help="the .rrd file")
    parser.add_argument("-o", "--output", metavar="OUT", type=Path,
                        help="the report (default: RECORDING.html; with --json: none)")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros.files.new_files import check_not_input, check_output
    from srt3d_ros.review.recorded import Recorded
    from srt3d_ros.review.summary import format_summary, summarise

    report = args.output or (None if args.json else args.recording.with_suffix(".html"))
    if report:
        check_not_input(check_output(report, suffix=".html"), args.recording)
    recorded = Recorded(args.recording)
    summary = summarise(recorded)
    if not args.json:
        print(format_summary(summary), flush=True)
    if report:
        from srt3d_ros.review.report import write_report

        write_report(recorded, summary, report)
    print(json.dumps(summary | {"report": str(report) if report else None}, allow_nan=False) if args.json
          else f"\n{report}")
    return 0
