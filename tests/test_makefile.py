"""What the Makefile says where it cannot work."""

import os
import shlex
import subprocess
import sys

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


def test_a_processor_without_wheels_of_ros_is_sent_elsewhere_in_one_line_and_nothing_is_made(repository, tmp_path):
    for target in ("demo", "test"):
        done = make(repository, "MACHINE=aarch64", f"VENV={tmp_path / 'venv'}", target)
        assert done.returncode and not (tmp_path / "venv").exists()
        assert done.stderr.startswith("PyPI has no ROS 2 for aarch64: install it with apt, or srt3d_ros without ROS; ")


def test_another_distribution_of_ros_is_refused(repository):
    assert "ROS=foxy: expected jazzy or kilted." in make(repository, "--dry-run", "demo", "ROS=foxy").stderr
