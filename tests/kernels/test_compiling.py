"""What numba makes of the kernels depends on their sources alone; `srt3d compile` makes it beforehand."""

import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import float32, int64
from numba.core.dispatcher import Dispatcher

import srt3d_ros
from srt3d_ros.kernels import cpu
from srt3d_ros.kernels.cpu.compiling import KERNELS, Kernel

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """
import numpy as np
from srt3d_ros.kernels.cpu.sketching import phase_sums
phase_sums.read_sums(np.zeros((1, 3), np.int64), 1)
print(sum(phase_sums._read_sums.compiled.stats.cache_hits.values()))
"""
FORKED = """
import multiprocessing, sys
import numpy as np
from srt3d_ros.kernels.cpu.sketching import phase_sums

def read(_): return len(phase_sums.read_sums(np.zeros((1, 3), np.int64), 1))

if __name__ == "__main__":
    read(0)
    with multiprocessing.get_context(sys.argv[1]).Pool(1) as pool:
        print(pool.map(read, [0]))
"""


def run(program: str, *arguments: str, **variables) -> subprocess.Popen:
    """A Python program that has begun."""
    return subprocess.Popen([sys.executable, "-c", program, *arguments], text=True, env=os.environ | variables,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE)


@pytest.mark.parametrize("processor", ["x86-64", "x86-64-v3"])
def test_vectors_are_numpys_on_other_processors(processor, tmp_path):
    with run("from tests.kernels.test_vectors import compare; compare()", NUMBA_CPU_NAME=processor,
             NUMBA_CPU_FEATURES="", NUMBA_CACHE_DIR=str(tmp_path), PYTHONPATH=str(ROOT)) as emulated:
        assert emulated.communicate()[1] == "" and emulated.returncode == 0


def test_no_kernel_is_compiled_with_fastmath():
    """With it the last bit of a cloud depends on whether its kernels were compiled just now or come from the cache."""
    names = [module.name for module in pkgutil.walk_packages(cpu.__path__, f"{cpu.__name__}.")]
    modules = map(importlib.import_module, names)
    compiled = [value for module in modules for value in vars(module).values() if isinstance(value, Dispatcher)]
    compiled += [kernel.compiled for kernel in KERNELS.values()]
    assert len(compiled) > 50
    assert not [kernel.__name__ for kernel in compiled if kernel.targetoptions.get("fastmath")]


def test_a_change_in_another_file_has_a_kernel_compiled_anew(tmp_path):
    package = tmp_path / "srt3d_ros"
    shutil.copytree(Path(srt3d_ros.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))

    def from_cache() -> int:
        run = subprocess.run([sys.executable, "-c", PROGRAM], cwd=tmp_path, capture_output=True, text=True, check=True,
                             env=os.environ | {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")})
        return int(run.stdout)

    assert [from_cache(), from_cache()] == [0, 1]       # kept
    for source in (package / "kernels" / "cpu" / "vectors.py", package / "kernels" / "maps.py"):
        source.write_text(source.read_text() + "\n# another constant, say\n")
        assert from_cache() == 0


@pytest.fixture
def total(monkeypatch) -> Kernel:
    """A kernel that is never on the disk."""
    monkeypatch.setattr(cpu.compiling, "FOLDER", None)

    def add(values: float32[::1], until: int64):
        return values[:until].sum()
    yield Kernel(add)
    del KERNELS["test_compiling.add"]


def test_a_kernel_takes_its_own_types_and_compiles_for_no_others(total):
    assert total(np.ones(4, np.float32), 2**33) == 4            # not the 1 that 32 bits would leave of it
    for values in (np.ones(4), np.ones(8, np.float32)[::2], np.ones((2, 2), np.float32)):
        with pytest.raises(TypeError, match="No matching definition"):
            total(values, 2)
    assert len(total.compiled.signatures) == 1


def test_two_programs_that_compile_at_once_both_finish_and_one_compiles(tmp_path):
    programs = [run(PROGRAM, NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(3)]
    hits = [int(program.communicate()[0]) for program in programs]
    assert sorted(hits) == [0, 1, 1] and len(list(tmp_path.rglob("*.nbc"))) == 1


def test_a_folder_to_which_others_may_write_is_not_used_and_it_says_so(tmp_path):
    def said(program: str) -> str:
        return "".join(run(program, NUMBA_CACHE_DIR=str(tmp_path)).communicate())

    named = "from srt3d_ros.kernels.cpu.compiling import FOLDER, NOT_KEPT; print(FOLDER, NOT_KEPT)"
    folder = Path(said(named).strip())
    assert list(tmp_path.iterdir()) == [folder] and folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o720)
    logged = said("import logging; logging.basicConfig(level=20)" + PROGRAM)
    assert f"at every start: {folder} is writable for others (chmod go-w)" in logged and not list(folder.rglob("*.nb?"))
    if os.getuid() == 0:
        os.chown(folder, 12345, -1)
        assert said(named) == f"None {folder} is another user's\n"


def test_a_folder_that_cannot_be_written_is_read_and_what_it_lacks_is_compiled_at_every_start(tmp_path):
    read_only = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c",
                 'mount --bind "$0" "$0" && mount -o remount,bind,ro "$0" && exec "$@"', str(tmp_path)]
    if subprocess.run([*read_only, "true"], capture_output=True).returncode:
        pytest.skip("this user may not mount a folder")
    cache = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    logged = "import logging; logging.basicConfig(level=20, format='%(message)s')" + PROGRAM

    def in_image() -> tuple[str, str]:
        done = subprocess.run([*read_only, sys.executable, "-c", logged], env=cache, capture_output=True, text=True)
        return done.stdout, done.stderr.replace("compiling kernels, for seconds up to two minutes ", "")

    advice = "is not writable; NUMBA_CACHE_DIR names another folder"
    assert in_image() == ("0\n", f"(at every start: {tmp_path} {advice})\n")
    run(PROGRAM, **cache).wait()
    assert in_image() == ("1\n", "")
    (folder,) = tmp_path.iterdir()
    next(folder.rglob("*.nbc")).unlink()
    assert in_image() == ("0\n", f"(at every start: {folder} {advice})\n")


def test_a_full_disk_keeps_no_kernel_from_running(tmp_path):
    full = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))" + PROGRAM
    hits, said = run(full, NUMBA_CACHE_DIR=str(tmp_path)).communicate()
    assert hits == "0\n" and said == f"compiled kernels cannot be kept in {next(tmp_path.iterdir())}: File too large\n"


def test_a_forked_process_names_spawn_instead_of_ending(tmp_path):
    (program := tmp_path / "program.py").write_text(FORKED)
    for method, code, said in (("spawn", 0, ""), ("fork", 1, 'multiprocessing.set_start_method("spawn")')):
        done = subprocess.run([sys.executable, program, method], capture_output=True, text=True)
        assert done.returncode == code and said in done.stderr


# ---- `srt3d compile`

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


def run_installed(installed: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess:
    """`srt3d …` of the installed copy, run in the checkout."""
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    # As a console script: without the working directory.
    return subprocess.run([sys.executable, "-P", "-c", RUN, *arguments], cwd=installed.parent / "checkout", text=True,
                          env=environment | {"PYTHONPATH": str(installed)} | variables, capture_output=True)


def test_the_copy_that_runs_is_compiled_and_only_once(installed, tmp_path):
    cache = tmp_path / "cache"
    first, second = (run_installed(installed, "compile", NUMBA_CACHE_DIR=str(cache)) for _ in range(2))
    assert (first.returncode, first.stderr, second.returncode, second.stderr) == (0, "", 0, "")
    (folder,) = cache.iterdir()
    assert first.stdout.startswith("compiled 1 kernels in ") and first.stdout.endswith(f"they are in {folder}\n")
    assert second.stdout.startswith("compiled 0 kernels in ")
    (code,) = cache.rglob("*.nbc")
    assert code.name.startswith("phase_sums._read_sums")


def test_where_nothing_can_be_written_it_says_what_to_set(installed, tmp_path):
    nowhere = tmp_path / "a file"
    nowhere.write_text("")
    done = run_installed(installed, "compile", HOME=str(nowhere), XDG_CACHE_HOME=str(nowhere))
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (f"srt3d: error: Cannot keep kernels: {nowhere}/srt3d_ros is not writable. "
                           "Set NUMBA_CACHE_DIR to a folder that only you can write to.\n")
