"""What numba makes of the kernels depends on their sources alone."""

import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
from pathlib import Path

from numba.core.dispatcher import Dispatcher

import srt3d_ros
from srt3d_ros.kernels import cpu

PROGRAM = """
import numpy as np
from srt3d_ros.kernels.cpu import phase_sums
phase_sums.read_sums(np.zeros((1, 3), np.int64), 1)
print(sum(phase_sums._read_sums.stats.cache_hits.values()))
"""


def test_no_kernel_is_compiled_with_fastmath():
    """With it the last bit of a cloud depends on whether its kernels were compiled just now or come from the cache."""
    names = [module.name for module in pkgutil.iter_modules(cpu.__path__, f"{cpu.__name__}.")]
    modules = map(importlib.import_module, names)
    compiled = [value for module in modules for value in vars(module).values() if isinstance(value, Dispatcher)]
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
    for source in (package / "kernels" / "cpu" / "rows.py", package / "kernels" / "maps.py"):
        source.write_text(source.read_text() + "\n# another constant, say\n")
        assert from_cache() == 0


def test_old_machine_code_is_removed_and_other_programs_keep_their_folder(tmp_path):
    for k in range(9):
        (tmp_path / f"srt3d-kernels-{k}").mkdir()
        os.utime(tmp_path / f"srt3d-kernels-{k}", (k, k))
    (tmp_path / "others").mkdir()
    program = "import numba; from srt3d_ros.kernels.cpu import phase_sums; print(numba.config.CACHE_DIR)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True,
                          env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)})
    left = {path.name for path in tmp_path.iterdir()}
    assert done.stdout.strip() == str(tmp_path)
    assert len(left) == 7 and {"others", *(f"srt3d-kernels-{k}" for k in range(4, 9))} <= left
