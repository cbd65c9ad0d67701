"""`srt3d`: runs a sub-command, and turns errors into one line and an exit code."""

import argparse
import importlib
import os
import sys
from collections.abc import Collection

from srt3d_ros import __version__
from srt3d_ros.cli import common
from srt3d_ros.errors import BAD_INPUT, InvalidInput, printable

# What `srt3d --help` says of each. Its module here has add_parser(subparsers), which sets run(args) -> int; `srt3d
# COMMAND --help` imports it, so slow packages (torch, ROS) are imported in run().
COMMANDS = {
    "reconstruct": "reconstruct a photon file or a frame of a bag and save the point cloud",
    "info": "print size, SBR and IRF of photon files, and a suitable gate and frequencies",
    "inspect": "draw one pixel of a photon file: its histogram, its points, and what they leave",
    "evaluate": "compare the methods on simulated scenes or on photon files",
    "up": "run the whole pipeline",
    "health": "print the state of every node, from /diagnostics",
    "node": "run one ROS 2 node, as `ros2 run srt3d_ros NAME` does",
    "review": "print the figures of a recording and write a report with pictures and plots",
    "demo": "run the whole pipeline on this machine: a recording, a picture and a table",
    "compile": "compile the kernels of the default method ahead of the first start",
}

INTERRUPTED = 130
BROKEN_PIPE = 141


class OneLineParser(argparse.ArgumentParser):
    """An ArgumentParser whose errors are one line, without the usage."""

    def error(self, message: str):
        self.exit(BAD_INPUT, f"srt3d: error: {printable(message)} (see {self.prog} --help)\n")


def parser(commands: Collection[str]) -> argparse.ArgumentParser:
    """The parser of `srt3d` with the options of these sub-commands, and the names of all."""
    top = OneLineParser(prog="srt3d", description="3D point clouds from single-photon lidar.",
                        epilog="Try srt3d reconstruct simulator -o cloud.png, and srt3d COMMAND --help.")
    top.add_argument("--version", action="version", version=f"srt3d {__version__}")
    subparsers = top.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name, about in COMMANDS.items():
        if name in commands:
            importlib.import_module(f"srt3d_ros.cli.{name}").add_parser(subparsers)
        else:
            subparsers.add_parser(name, help=about)
    return top


def main(argv: list[str] | None = None) -> int:
    """Run `srt3d` with `argv` (default: the command line).

    Returns:
        The exit code: 0 done, 1 failed, 2 bad input, 130 interrupted.
    """
    argv, args = sys.argv[1:] if argv is None else argv, argparse.Namespace()
    named = argv[0] if argv and argv[0] in COMMANDS else ""
    try:
        top = parser((named,) if named else ())
        if not argv:
            top.print_help()
            return BAD_INPUT
        args, unknown = top.parse_known_args(argv)
        if unknown:
            top.prog = f"{top.prog} {named}"        # the error refers to the sub-command's help
            top.error(f"unrecognized arguments: {' '.join(unknown)}")
        code = args.run(args)
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        # The reader, `head` say, has closed the pipe. Let Python's flush at exit write to nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except KeyboardInterrupt:
        return INTERRUPTED
    except InvalidInput as error:
        return _say(_in_flags(error, vars(args)), BAD_INPUT)
    except OSError as error:
        if error.filename is None:
            raise
        return _say(printable(f"{error.filename}: {error.strerror}"), BAD_INPUT)
    except ModuleNotFoundError as error:
        return _say(common.missing_package(error, named), common.FAILED)


def _in_flags(error: InvalidInput, options: Collection[str]) -> str:
    """The error with the option of the command line where the library names its argument."""
    name = error.field
    if name not in options or name == "input":
        return str(error)
    flag = f"--{name.replace('_', '-')}"
    problem = error.problem.replace(name, flag) if "_" in name else error.problem       # others may be plain words
    return str(InvalidInput(flag, error.value, error.expected, problem))


def _say(message: str, code: int) -> int:
    print(f"srt3d: error: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
