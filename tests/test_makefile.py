"""What the Makefile's commands install, and their message for an old Python."""

import os
import re
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


def test_a_processor_without_wheels_of_ros_is_sent_elsewhere_in_one_line_and_nothing_is_made(repository, tmp_path):
    for target in ("demo", "test"):
        done = make(repository, "MACHINE=aarch64", f"VENV={tmp_path / 'venv'}", target)
        assert done.returncode and not (tmp_path / "venv").exists()
        assert done.stderr.startswith("PyPI has no ROS 2 for aarch64: install it with apt, or srt3d_ros without ROS; ")


def test_the_tests_of_other_processors_share_no_compiled_code_with_this_one(repository):
    lines = make(repository, "--dry-run", "VENV=.venv", "test-processors").stdout.replace("\\\n", "").splitlines()
    for name in ("x86-64", "x86-64-v3"):
        (line,) = (line for line in lines if f"NUMBA_CPU_NAME={name} " in line)
        words = shlex.split(line)
        assert {"NUMBA_CPU_FEATURES=", "ATEN_CPU_CAPABILITY=default", "tests/core", "tests/kernels"} < set(words)
        assert {f"{variable}={repository}/build/{name}/{of}" for variable, of in
                (("NUMBA_CACHE_DIR", "numba"), ("TORCHINDUCTOR_CACHE_DIR", "torch"))} < set(words)


@pytest.mark.parametrize(("target", "extras", "pinned"), [
    ("demo", ["ros,record,review"], True), ("docs", ["docs"], True),
    ("test", ["ros,record,review", "test"], True), ("test-newest", ["ros,record,review", "test"], False),
    ("test ROS=kilted", ["ros-kilted,record,review", "test"], True)])
def test_a_target_installs_and_compiles_no_more_than_it_needs(repository, tmp_path, target, extras, pinned):
    commands = make(repository, "--dry-run", "--always-make", f"VENV={tmp_path / 'venv'}", *target.split()).stdout
    assert [found.removesuffix(",gpu") for found in re.findall(r"'\.\[(.+)\]'", commands)] == extras
    assert ("-c constraints.txt" in commands) == pinned
    assert ("srt3d compile" in commands) == (extras != ["docs"])


def test_each_distribution_of_ros_has_its_own_environment_and_others_are_refused(repository):
    assert ".venv/bin/srt3d demo" in make(repository, "--dry-run", "demo").stdout
    assert ".venv-kilted/bin/srt3d demo" in make(repository, "--dry-run", "demo", "ROS=kilted").stdout
    assert "ROS=foxy: expected jazzy or kilted." in make(repository, "--dry-run", "demo", "ROS=foxy").stderr
