"""`srt3d review`: what a recording holds, without a viewer or a screen."""

import argparse
import json
import subprocess
import sys
from pathlib import Path

from srt3d_ros.cli import common
from srt3d_ros.errors import require

# What Python writes to stderr is shown; what rerun writes there as it ends the process is not.
_CHILD = """
import os, sys
from srt3d_ros.cli.main import main
sys.stderr = os.fdopen(os.dup(2), "w", buffering=1)
os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
sys.exit(main(sys.argv[1:]))
"""


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "review", help="what a recording holds: figures, and a report with pictures and plots",
        description="Print the figures of a recording (.rrd) and write a report with pictures and plots that opens in "
                    "any browser.")
    parser.add_argument("recording", metavar="RECORDING", type=Path, help="the .rrd file")
    parser.add_argument("-o", "--output", metavar="OUT", type=Path, help="the report (RECORDING.html)")
    parser.add_argument("--no-report", action="store_true", help="print the figures only")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros.new_files import check_not_input, check_place

    report = args.output or args.recording.with_suffix(".html")
    require(args.output is None or not args.no_report, "-o", str(args.output), "a report, without --no-report")
    require(report.suffix.lower() in (".html", ".htm"), "output", str(report), "a file name that ends in .html, .htm")
    if not args.no_report:
        check_not_input(report, args.recording)
        check_place(report)
    if args.typed is None:
        return _review(args.recording, None if args.no_report else report, args.json)
    # In another process: at some chunks that are damaged, rerun ends the one that reads them.
    code = subprocess.run([sys.executable, "-P", "-c", _CHILD, *args.typed]).returncode
    require(code >= 0, "recording", str(args.recording), "an .rrd file whose chunks can be read")
    return code


def _review(path: Path, report: Path | None, as_json: bool) -> int:
    from srt3d_ros.review.recorded import Recorded
    from srt3d_ros.review.summary import format_summary, summarise

    recorded = Recorded.read(path)
    summary = summarise(recorded)
    if not as_json:
        print(format_summary(summary), flush=True)
    if report is not None:
        from srt3d_ros.review.report import write_report

        write_report(recorded, summary, report)
    if as_json:
        print(json.dumps(summary | {"report": report and str(report)}, allow_nan=False))
    elif report:
        print(f"\n{report}")
    return 0
