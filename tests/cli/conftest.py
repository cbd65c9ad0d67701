"""Runs `srt3d` in this process."""

import pytest

from srt3d_ros.cli import main


@pytest.fixture
def srt3d(capsys):
    """A function of the arguments: exit code, what was printed on stdout, and on stderr."""
    def run(*arguments: object) -> tuple[int, str, str]:
        try:
            code = main.main([str(argument) for argument in arguments])
        except SystemExit as stopped:
            code = stopped.code
        return code, *capsys.readouterr()

    return run


@pytest.fixture
def refusal(srt3d):
    """A function of the arguments: the one line of error; the exit code is 2, and nothing else is printed."""
    def run(*arguments: object) -> str:
        code, out, err = srt3d(*arguments)
        assert (code, out) == (2, "")
        assert err.startswith("srt3d: error: ") and err.count("\n") == 1 and err[:-1].isprintable()
        return err.removeprefix("srt3d: error: ")

    return run
