"""`srt3d view`: recordings in the rerun viewer."""

import argparse
import os
import sys
from pathlib import Path

from srt3d_ros.errors import require


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "view", help="open recordings in the rerun viewer",
        description="Open recordings (.rrd) in the rerun viewer: the parts of one recording together. On a machine "
                    "without a screen, `srt3d review` draws a report.")
    parser.add_argument("recording", metavar="RECORDING", nargs="+", type=Path, help=".rrd file")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    import rerun_cli

    from srt3d_ros.recording.rrd_file import is_finished
    for path in args.recording:
        is_finished(path)       # rerun would show any file as text
    screen = sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    require(screen, "DISPLAY", "not set", "a screen; copy the recordings to a machine that has one, or `srt3d review` "
            "them here")
    # In place of this process, so that signals reach it. The viewer is a server, too: of this machine alone.
    viewer = str(Path(rerun_cli.__file__).with_name("rerun"))
    os.execv(viewer, [viewer, "--bind", "127.0.0.1", *map(str, args.recording)])
