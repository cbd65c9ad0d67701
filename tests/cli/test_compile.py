"""`srt3d compile` compiles the copy that will run, and what has to compile later says so."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import srt3d_ros

RUN = "import sys, srt3d_ros.cli.main as main; sys.exit(main.main(sys.argv[1:]))"
ONE_KERNEL = """
def names():
    return ["phase_sums._read_sums"]
"""


@pytest.fixture
def installed(tmp_path) -> Path:
    """A folder with a copy of the package that has one small kernel to compile; and another copy, in `checkout`."""
    source = Path(srt3d_ros.__file__).parent
    for place in (tmp_path / "site", tmp_path / "checkout"):
        shutil.copytree(source, place / "srt3d_ros", ignore=shutil.ignore_patterns("__pycache__"))
    with (tmp_path / "site" / "srt3d_ros" / "precompile.py").open("a") as precompile:
        precompile.write(ONE_KERNEL)
    return tmp_path / "site"


def srt3d(installed: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess:
    """`srt3d …` of the installed copy, run in the checkout."""
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    # As a console script: without the working directory.
    return subprocess.run([sys.executable, "-P", "-c", RUN, *arguments], cwd=installed.parent / "checkout", text=True,
                          env=environment | {"PYTHONPATH": str(installed)} | variables, capture_output=True)


def test_the_copy_that_runs_is_compiled_and_only_once(installed, tmp_path):
    cache = tmp_path / "cache"
    first, second = (srt3d(installed, "compile", NUMBA_CACHE_DIR=str(cache)) for _ in range(2))
    assert (first.returncode, first.stderr, second.returncode, second.stderr) == (0, "", 0, "")
    (folder,) = cache.iterdir()
    assert first.stdout.startswith("compiled 1 kernels in ") and first.stdout.endswith(f"they are in {folder}\n")
    assert second.stdout.startswith("compiled 0 kernels in ")
    (code,) = cache.rglob("*.nbc")
    assert code.name.startswith("phase_sums._read_sums")


def test_where_nothing_can_be_written_it_says_what_to_set(installed, tmp_path):
    nowhere = tmp_path / "a file"
    nowhere.write_text("")
    done = srt3d(installed, "compile", HOME=str(nowhere), XDG_CACHE_HOME=str(nowhere))
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (f"srt3d: error: Cannot keep kernels: {nowhere}/srt3d_ros is not writable. "
                           "Set NUMBA_CACHE_DIR to a folder that only you can write to.\n")
