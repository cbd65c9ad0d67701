"""`srt3d`: finds the sub-command, runs it, and turns what goes wrong into one line and an exit code."""

import argparse
import importlib
import os
import sys

from srt3d_ros import __version__
from srt3d_ros.errors import InvalidInput, printable

# Modules here with add_parser(subparsers), which sets run(args) -> int. Only the one asked for is imported, all for
# `srt3d --help`: they import what is slow (torch, ROS) in run().
COMMANDS = ("reconstruct", "info", "evaluate", "up", "health", "play", "node", "review", "demo",
            "compile")
MODULES = {"play": "node"}      # those that are not called as their command

# Optional packages: how to get what a command turns out to need.
EXTRAS = {"rclpy": "ros", "std_msgs": "ros", "diagnostic_msgs": "ros", "sensor_msgs": "ros", "nav_msgs": "ros",
          "rerun": "record", "matplotlib": "review", "PIL": "review",
          "jinja2": "review", "rosbags": "bags", "torch": "gpu", "ptufile": "lab"}
DRAWING = ("demo", "review")        # commands that need all of `review`, which includes `record`

FAILED = 1
BAD_INPUT = 2
INTERRUPTED = 130
BROKEN_PIPE = 141


class OneLineParser(argparse.ArgumentParser):
    """An ArgumentParser that says what is wrong in one line; `srt3d … --help` shows the usage."""

    def error(self, message: str):
        self.exit(BAD_INPUT, f"srt3d: error: {printable(message)} (see {self.prog} --help)\n")


def parser(commands: tuple[str, ...]) -> argparse.ArgumentParser:
    """The command line of `srt3d` with these sub-commands."""
    top = OneLineParser(prog="srt3d", description="3D point clouds from single-photon lidar.")
    top.add_argument("--version", action="version", version=f"srt3d {__version__}")
    subparsers = top.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for module in dict.fromkeys(MODULES.get(name, name) for name in commands):
        importlib.import_module(f"srt3d_ros.cli.{module}").add_parser(subparsers)
    return top


def main(argv: list[str] | None = None) -> int:
    """Run `srt3d` with these arguments, the command line's unless given; returns the exit code.

    0 done, 1 failed, 2 bad input, 130 interrupted.
    """
    argv = sys.argv[1:] if argv is None else argv
    named = argv[0] if argv and argv[0] in COMMANDS else ""
    try:
        top = parser((named,) if named else COMMANDS)
        args, unknown = top.parse_known_args(argv)
        if unknown:
            top.prog = f"{top.prog} {named}"        # whose help is the one to see
            top.error(f"unrecognized arguments: {' '.join(unknown)}")
        code = args.run(args)
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        # The reader, `head` say, has seen enough. Python flushes once more at exit: into nothing.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except KeyboardInterrupt:
        return INTERRUPTED
    except InvalidInput as error:
        return _say(str(error), BAD_INPUT)
    except OSError as error:
        if error.filename is None:
            raise
        return _say(printable(f"{error.filename}: {error.strerror}"), BAD_INPUT)
    except ModuleNotFoundError as error:
        if error.name not in EXTRAS:
            raise
        ros = "source a ROS 2 installation, or " if EXTRAS[error.name] == "ros" else ""
        extra = "review" if error.name == "rerun" and named in DRAWING else EXTRAS[error.name]
        return _say(f"{error.name} is not installed: {ros}pip install 'srt3d_ros[{extra}]'", FAILED)


def _say(message: str, code: int) -> int:
    print(f"srt3d: error: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
