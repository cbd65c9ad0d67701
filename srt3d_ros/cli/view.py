"""`srt3d view`: recordings, or a recorder that is at work, in the rerun viewer; or how to see them from elsewhere."""

import argparse
import getpass
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

from srt3d_ros import processes
from srt3d_ros.errors import require

PORT = 9876             # rerun's own
LOOPBACK = "127.0.0.1"
SERVER_MEMORY = "50%"   # of the machine's
TIMEOUT_S = 5.0


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "view", help="open recordings, or watch a recorder at work, in the rerun viewer",
        description="Open recordings (.rrd) in the rerun viewer: the parts of one recording together. With --connect, "
                    "watch a recorder whose parameter live_port is PORT. Without a screen here, say what to type on a "
                    "machine that has one.")
    parser.add_argument("recording", metavar="RECORDING", nargs="*", type=Path, help=".rrd file")
    parser.add_argument("--connect", metavar="HOST:PORT", help=f"where a recorder serves, such as {LOOPBACK}:{PORT}")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    require(bool(args.recording) != (args.connect is not None), "RECORDING", "missing" if not args.recording else "too "
            "much beside --connect", "one or more .rrd files, or --connect HOST:PORT")
    import rerun  # noqa: F401  (says how to get it if it is not there)

    from srt3d_ros.recording.rrd_file import is_finished
    for path in args.recording:
        is_finished(path)       # rerun would show any file as text, and serve it
    if args.connect is None:
        return _open(*map(str, args.recording)) if has_screen() else _serve(args.recording)
    host, port = _checked_address(args.connect)
    if has_screen():
        _open(f"rerun+http://{host}:{port}/proxy")
    print(directions(host, port))
    return 0


def has_screen() -> bool:
    """Whether a window can be opened."""
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def directions(host: str, port: int) -> str:
    """What to type on a machine with a screen to see what is served at host:port."""
    here = os.environ.get("SSH_CONNECTION", "").split()[2:3] or [socket.gethostname()]
    return (f"There is no screen here. On the machine where you sit:\n\n"
            f"  ssh -L {port}:{host}:{port} {_user()}{here[0]}\n\n"
            f"and beside it, while that is open:\n\n"
            f"  srt3d view --connect {LOOPBACK}:{port}\n\n"
            f"or, with rerun-sdk alone:  rerun rerun+http://{LOOPBACK}:{port}/proxy")


def _user() -> str:
    """Who we are, as ssh wants it before a host; nothing where nobody knows, as in many containers."""
    try:
        return f"{getpass.getuser()}@"
    except (KeyError, OSError):
        return ""


def _checked_address(text: str) -> tuple[str, int]:
    host, colon, port = text.rpartition(":")
    require(bool(colon and host) and port.isdigit() and 0 < int(port) < 65536, "--connect", text,
            f"HOST:PORT, such as {LOOPBACK}:{PORT}")
    try:
        socket.create_connection((host, int(port)), TIMEOUT_S).close()
    except OSError as e:
        require(False, "--connect", text, f"a recorder that serves there, with live_port:={port} ({e.strerror or e})")
    return host, int(port)


def _open(*arguments: str) -> NoReturn:
    """Become the viewer, so that signals reach it: rerun's own script starts it as a child, which would outlive it."""
    command = _viewer(*arguments)
    os.execv(command[0], command)


def _serve(recordings: list[Path]) -> int:
    """Serve the recordings on the loopback interface until Ctrl-C, which rerun's server alone would not heed."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        port = probe.getsockname()[1]
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, signal.default_int_handler)
    print(directions(LOOPBACK, port) + "\n\nServing until Ctrl-C.", flush=True)
    server = subprocess.Popen(_viewer("--serve-grpc", "--port", str(port), "--server-memory-limit", SERVER_MEMORY,
                                      *map(str, recordings)))
    try:
        return server.wait()
    except KeyboardInterrupt:
        return 0
    finally:
        processes.stop(server, TIMEOUT_S)


def _viewer(*arguments: str) -> list[str]:
    """The command of the viewer, which is a server, too, and by default listens to the whole network."""
    import rerun_cli
    return [str(Path(rerun_cli.__file__).with_name("rerun")), "--bind", LOOPBACK, *arguments]
