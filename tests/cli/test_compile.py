"""`srt3d compile` compiles the copy that will run, and what has to compile later says so."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import srt3d_ros

RUN = "import sys, srt3d_ros.cli.main as main; sys.exit(main.main(sys.argv[1:]))"
SMALLER = """
def sketching():
    from srt3d_ros.kernels.cpu import phase_sums
    phase_sums._border(np.arange(3, dtype=np.uint32), 1)
def birth_death():
    pass
BASELINES = ()
PARTS = (birth_death,), (sketching,)
"""
ONE_KERNEL = """
def missing(also_baselines=True):
    return [kernel for kernel in KERNELS if name_of(kernel) == "phase_sums._border" and not _has_code(kernel)]
"""


@pytest.fixture
def installed(tmp_path) -> Path:
    """A folder with a copy of the package that has one small kernel to compile; and another copy, in `checkout`."""
    source = Path(srt3d_ros.__file__).parent
    for place in (tmp_path / "site", tmp_path / "checkout"):
        shutil.copytree(source, place / "srt3d_ros", ignore=shutil.ignore_patterns("__pycache__"))
        ahead = place / "srt3d_ros" / "core" / "precompile.py"
        ahead.write_text("import numpy as np\n" + SMALLER)
        compiling = place / "srt3d_ros" / "kernels" / "cpu" / "compiling.py"
        compiling.write_text(compiling.read_text() + ONE_KERNEL)
    return tmp_path / "site"


def srt3d(installed: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess:
    """`srt3d …` of the installed copy, run in the checkout."""
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    # As a console script: without the working directory.
    return subprocess.run([sys.executable, "-P", "-c", RUN, *arguments], cwd=installed.parent / "checkout", text=True,
                          env=environment | {"PYTHONPATH": str(installed)} | variables, capture_output=True)


def caches(folder: Path) -> int:
    return len(list(folder.rglob("*.nbc")))


def test_the_copy_that_runs_is_compiled_and_named_and_only_once(installed, tmp_path):
    first, second = srt3d(installed, "compile"), srt3d(installed, "compile")
    assert (first.returncode, first.stderr, second.returncode, second.stderr) == (0, "", 0, "")
    package = installed / "srt3d_ros"
    begin, end = first.stdout.splitlines()
    assert begin == f"compiling the CPU kernels of {package}"
    assert end.startswith("compiled 1 kernels in ") and end.endswith(f"they are in {package}/kernels/cpu/__pycache__")
    assert (caches(installed), caches(tmp_path / "checkout")) == (1, 0)
    assert second.stdout == f"already compiled: the CPU kernels of {package} are in {package}/kernels/cpu/__pycache__\n"


def test_a_process_that_fails_is_one_line(installed):
    ahead = installed / "srt3d_ros" / "core" / "precompile.py"
    ahead.write_text(ahead.read_text().replace("    pass", "    import os; os._exit(7)"))
    done = srt3d(installed, "compile")
    assert (done.returncode, done.stderr) == (1, "srt3d: error: a process that compiles died (too little memory?)\n")


def test_where_the_package_cannot_be_written_the_kernels_are_kept_for_the_user_or_nowhere(installed, tmp_path):
    # numba finds a file where its folder beside the kernels would be: root can write to any folder.
    folder = installed / "srt3d_ros" / "kernels" / "cpu" / "__pycache__"
    shutil.rmtree(folder, ignore_errors=True)
    folder.write_text("")
    done = srt3d(installed, "compile", HOME=str(tmp_path), XDG_CACHE_HOME=str(tmp_path / "cache"))
    assert (done.returncode, done.stderr, caches(tmp_path / "cache")) == (0, "", 1)
    assert f"they are in {tmp_path}/cache/numba/" in done.stdout
    assert done.stdout.endswith(", for this user: the package is read-only\n")
    nowhere = tmp_path / "a file"
    nowhere.write_text("")
    done = srt3d(installed, "compile", HOME=str(nowhere), XDG_CACHE_HOME=str(nowhere))
    assert (done.returncode, done.stderr) == (0, "")
    assert "kept nowhere, so every start compiles them" in done.stdout and "NUMBA_CACHE_DIR" in done.stdout


def test_what_has_to_be_compiled_for_a_command_is_said_in_one_line(repository, tmp_path):
    """By a copy that lacks the code of one kernel only, if `srt3d compile --all` has compiled all of them here."""
    shutil.copytree(repository / "msg_schemas", tmp_path / "site" / "msg_schemas")
    (tmp_path / "checkout").mkdir()
    package = shutil.copytree(Path(srt3d_ros.__file__).parent, tmp_path / "site" / "srt3d_ros")
    for file in package.rglob("gradients._pixelwise*.nb[ci]"):
        file.unlink()
    photons = tmp_path / "a.npz"
    np.savez(photons, pixel=np.zeros(9, np.uint32), toa=np.arange(9, dtype=np.uint16), rows=1, cols=1, num_bins=10,
             bin_width_s=1e-10, irf=np.ones(3), fov_deg=30)
    done = srt3d(package.parent, "reconstruct", photons, "-o", tmp_path / "a.ply", "--method", "smle")
    first, *others = done.stderr.splitlines()
    assert done.returncode == 0
    assert re.match(r"srt3d: compiling \d kernels for methods that are not the default, about \d s \(once; ", first)
    assert all(" for sketching, " in line for line in others)
