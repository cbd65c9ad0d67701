"""What the Makefile's commands install, and their message for an old Python."""

import os
import shlex
import subprocess
import sys

import pytest

OLD = """#!/bin/sh
exec {python} -c "import sys; sys.version_info = (3, 10, 1); exec(sys.argv[1])" "$2"
"""


def make(repository, *arguments, cwd=None) -> subprocess.CompletedProcess:
    own = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))}
    return subprocess.run(["make", "-f", repository / "Makefile", *arguments], cwd=cwd or repository, env=own,
                          capture_output=True, text=True)


def test_an_old_python_is_told_what_to_do_in_one_line_and_nothing_is_made(repository, tmp_path):
    python = tmp_path / "python"
    python.write_text(OLD.format(python=shlex.quote(sys.executable)))
    python.chmod(0o755)
    done = make(repository, f"PYTHON={python}", f"VENV={tmp_path / 'venv'}", "demo")
    assert done.returncode and not (tmp_path / "venv").exists()
    assert done.stderr.startswith("srt3d_ros needs Python 3.11 or newer and this is 3.10: try make PYTHON=python3.12\n")


@pytest.mark.parametrize(("target", "tools", "pinned"), [
    ("demo", False, True), ("test", True, True), ("test-newest", True, False)])
def test_the_demo_installs_no_test_tools_and_all_but_newest_are_pinned(repository, tmp_path, target, tools, pinned):
    commands = make(repository, "--dry-run", "--always-make", f"VENV={tmp_path / 'venv'}", target).stdout
    assert (".[test]" in commands) == tools
    assert ("-c constraints.txt" in commands) == pinned
    assert ".[ros,record,review" in commands
