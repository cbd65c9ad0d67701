"""`srt3d review`: what a recording holds, without a viewer or a screen."""

import argparse
import json
from pathlib import Path

import numpy as np

from srt3d_ros.bounded_call import ChildFailed, call
from srt3d_ros.cli import common
from srt3d_ros.errors import InvalidInput, require


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "review", help="what a recording holds: figures, a report with pictures and plots, single clouds",
        description="Print the figures of a recording (.rrd) and write a report with pictures and plots that opens in "
                    "any browser. A recording that was cut off is repaired into a copy first; the original is never "
                    "changed.")
    parser.add_argument("recording", metavar="RECORDING", type=Path, help="the .rrd file")
    parser.add_argument("-o", "--output", metavar="OUT", type=Path,
                        help="the report (RECORDING.html), or with --frame the cloud: .npz .ply .pcd .rrd .png .jpg")
    parser.add_argument("--no-report", action="store_true", help="print the figures only")
    common.add_json(parser)
    parser.add_argument("--pictures", choices=("auto", "viewer", "own"), default="auto",
                        help="who draws: the rerun viewer, which needs Vulkan, or srt3d_ros itself (auto: as possible)")
    instead = parser.add_argument_group("instead of figures and report").add_mutually_exclusive_group()
    instead.add_argument("--frame", type=int, metavar="N", help="save the cloud of frame N to -o; -1 is the last")
    instead.add_argument("--turntable", type=Path, metavar="OUT",
                         help="save a film of a typical cloud turning, .gif, or .mp4 with imageio-ffmpeg")
    instead.add_argument("--compare", type=Path, metavar="RRD", help="compare with another recording, frame by frame")
    instead.add_argument("--to-bag", type=Path, metavar="DIR", help="write the clouds as a bag with the topic /points")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    if args.typed is not None:
        return _in_child(args)
    _check(args)
    from srt3d_ros.review.recorded import Recorded

    path, notes = _readable(args.recording)
    recorded = Recorded.read(path)
    if args.frame is not None or args.turntable is not None or args.to_bag is not None:
        return _export(args, recorded)
    if args.compare is not None:
        return _compare(args, recorded)
    return _review(args, recorded, notes)


def _in_child(args: argparse.Namespace) -> int:
    """Have another process do it: at some chunks that are damaged, rerun ends the one that reads them."""
    try:
        return call(exit_code, args.typed)["code"].item()
    except ChildFailed as error:
        paths = " or ".join(str(path) for path in (args.recording, args.compare) if path)
        raise InvalidInput("recording", paths, f"an .rrd file whose chunks can be read: its reader {error}"
                           ) from None


def exit_code(argv: list[str]) -> dict[str, np.ndarray]:
    """That of `srt3d` with these arguments, run in this process."""
    from srt3d_ros.cli.main import main

    return {"code": np.array(main(argv))}


def _check(args: argparse.Namespace) -> None:
    """Refuse what cannot be written before minutes are spent."""
    from srt3d_ros.new_files import check_not_input
    from srt3d_ros.review import export

    if args.output is not None:
        check_not_input(args.output, args.recording)
    if args.frame is not None:
        require(args.output is not None, "-o", "missing", f"a file for the cloud: {', '.join(export.FRAME_SUFFIXES)}")
        export.check_output(args.output, export.FRAME_SUFFIXES)
    elif args.turntable is not None:
        export.check_output(args.turntable, export.TURNTABLE_SUFFIXES)
    elif args.output is not None:
        require(args.compare is None and args.to_bag is None and not args.no_report, "-o", str(args.output),
                "a report or a cloud to be asked for")
        export.check_output(args.output, (".html", ".htm"))


def _readable(path: Path) -> tuple[Path, tuple[str, ...]]:
    """The recording itself, or a repaired copy and notes on it, which are printed."""
    from srt3d_ros.recording.repair import examine, repair

    if examine(path):
        return path, ()
    copy = repair(path)
    notes = (f"{path} was not finished: repaired into {copy}, with all chunks that are whole",)
    common.print_notes(notes)
    return copy, notes


def _review(args: argparse.Namespace, recorded, notes: tuple[str, ...]) -> int:
    from srt3d_ros.review.summary import format_summary, summarise

    summary, report = summarise(recorded), None
    if not args.json:
        print(format_summary(summary), flush=True)
    if not args.no_report:
        from srt3d_ros.review.report import write_report

        report = args.output or args.recording.with_suffix(".html")
        write_report(recorded, summary, report, args.pictures, notes)
    if args.json:
        print(json.dumps(summary | {"notes": list(notes), "report": report and str(report)}, allow_nan=False))
    elif report:
        print(f"\n{report}")
    return 0


def _export(args: argparse.Namespace, recorded) -> int:
    from srt3d_ros.review import export
    from srt3d_ros.review.summary import notable_frames

    if args.to_bag is not None:
        facts = {"clouds": export.save_bag(recorded, args.to_bag), "output": str(args.to_bag)}
        common.print_facts(args, facts, "{clouds:,} clouds on /points\n{output}")
        return 0
    place = recorded.frame_at(args.frame) if args.frame is not None else notable_frames(recorded)[0]
    facts = {"frame": int(recorded.index.frame_index[place]), "stamp_ns": int(recorded.index.stamp_ns[place]),
             "points": int(recorded.index.points[place]), "output": str(args.turntable or args.output)}
    if args.turntable is not None:
        export.save_turntable(recorded, place, args.turntable)
        common.print_facts(args, facts, "frame {frame}, {points:,} points\n{output}")
    else:
        export.save_frame(recorded, place, args.output, args.pictures)
        common.print_facts(args, facts, "{points:,} points of frame {frame}\n{output}")
    return 0


def _compare(args: argparse.Namespace, recorded) -> int:
    from srt3d_ros.review.compare import compare, format_comparison
    from srt3d_ros.review.recorded import Recorded

    other, _ = _readable(args.compare)
    comparison = compare(recorded, Recorded.read(other))
    print(json.dumps(comparison, allow_nan=False) if args.json else format_comparison(comparison))
    return 0
