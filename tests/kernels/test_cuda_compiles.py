"""The CUDA kernels compile for an H100: Triton's interpreter, which runs them in the other tests, takes more than that.

No GPU is needed. Triton is told that there is one, and asked to compile whatever the functions would launch.
"""

import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

KERNELS = ["birth_death._choose", "birth_death._list_undecided", "pooled_step._coarsen", "pooled_step._step"]


def test_kernels_compile_for_an_h100():
    pytest.importorskip("triton")
    environment = {name: value for name, value in os.environ.items() if name != "TRITON_INTERPRET"}
    run = subprocess.run([sys.executable, __file__], env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == KERNELS


def compile_all() -> list[str]:
    """Call the functions and return the names of the kernels that they compiled."""
    import torch
    from triton.backends.compiler import GPUTarget
    from triton.runtime.driver import driver
    from triton.runtime.jit import JITFunction

    compiled, run = set(), JITFunction.run

    def compile_only(kernel, *args, grid, warmup, **options):
        machine_code = run(kernel, *args, grid=grid, warmup=True, **options).asm["cubin"]
        compiled.update([f"{kernel.fn.__module__.rsplit('.')[-1]}.{kernel.__name__}"] if machine_code else [])

    JITFunction.run = compile_only
    driver.set_active(SimpleNamespace(get_current_device=lambda: 0, get_current_stream=lambda device: 0,
                                      get_current_target=lambda: GPUTarget("cuda", 90, 32)))
    from srt3d_ros.kernels import cuda, maps

    m, shape = 10, maps.padded_shape(4, 64)
    arrays = {name: torch.zeros(size) for name, size in {
        "matched": (shape[0], 2 * m, shape[1]), "counts": shape, "exposure": shape, "energy": m, "bin_frequencies": m,
        "moments": 2, "intensity_moments": 2, "background_table": 257}.items()}
    frame = SimpleNamespace(**arrays, num_bins=300, max_response=1.0, total_energy=5.0, curvature=0.1,
                            resolution_bins=7.0, shape=(4, 64))
    for surfaces in (1, 2):
        state = torch.zeros(shape[0], surfaces, maps.FIELDS, shape[1])
        terms = cuda.expand(frame, state)
        cuda.pooled_step(frame, state, terms, 2.0, maps.MARGIN if surfaces > 1 else 3, 23.0)
    cuda.birth_death(frame, state[:, :1].contiguous(), terms[:, :1].contiguous(), 23.0)
    return sorted(compiled)


if __name__ == "__main__":
    print(*compile_all())
