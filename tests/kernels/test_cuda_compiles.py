"""The CUDA kernels compile for an H100: Triton's interpreter, which runs them in the other tests, takes more than that.

No GPU is needed. Triton is told that there is one, and asked to compile whatever the functions would launch.
"""

import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

KERNELS = ["_apss", "_blur_cols", "_blur_rows", "_choose", "_descend", "_evidence", "_explain", "_match",
           "_own_intensity", "_pixelwise", "_poisson", "_relief", "survey"]


def test_kernels_compile_for_an_h100():
    pytest.importorskip("triton")
    environment = {name: value for name, value in os.environ.items() if name != "TRITON_INTERPRET"}
    run = subprocess.run([sys.executable, __file__], env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == KERNELS


def compile_all() -> list[str]:
    """Call every function and return the names of the kernels that it compiled."""
    import torch
    from triton.backends.compiler import GPUTarget
    from triton.runtime.driver import driver
    from triton.runtime.jit import JITFunction

    compiled, run = set(), JITFunction.run

    def compile_only(kernel, *args, grid, warmup, **options):
        machine_code = run(kernel, *args, grid=grid, warmup=True, **options).asm["cubin"]
        compiled.update([kernel.__name__] if machine_code else [])

    JITFunction.run = compile_only
    driver.set_active(SimpleNamespace(get_current_device=lambda: 0, get_current_stream=lambda device: 0,
                                      get_current_target=lambda: GPUTarget("cuda", 90, 32)))
    from srt3d_ros.core import layout
    from srt3d_ros.kernels import cuda

    m, surfaces, shape, rows, cols = 10, 2, (16, 76), 4, 64
    maps = {name: torch.zeros(size) for name, size in {
        "matched": (shape[0], 2 * m, shape[1]), "noise": shape, "exposure": shape, "energy": m, "cycles": m,
        "moments": 2, "intensity_moments": 2, "rarity": 257}.items()}
    data = SimpleNamespace(**maps, num_bins=300, greatest_response=1.0)
    state = torch.zeros(shape[0], surfaces, layout.FIELDS, shape[1])
    cuda.blur(torch.zeros(rows, 2 * m, cols), torch.zeros(12), 2)
    cuda.match(torch.zeros(rows, 2 * m, cols), data.energy, data.cycles, 300, surfaces)
    cuda.descend(data, state, layout.MARGIN, 23.0)
    cuda.evidence(data, state)
    cuda.own_intensity(data, state)
    cuda.relief(state, 5.0, layout.MARGIN, 23.0, 300)
    cuda.propose(data, state[:, :1].contiguous(), 1.5, 23.0, 1)
    points, image = torch.zeros(rows, surfaces, cols), torch.zeros(rows, cols)
    cuda.pixelwise(data, torch.zeros(65, 4, m), 0.5, 1.0, points, points)
    photons = SimpleNamespace(starts=torch.zeros(rows * cols + 1, dtype=torch.int64), toa=image, irf=image, slope=image,
                              exposure=image, ref=1, information=1.0, num_bins=300)
    cuda.poisson(photons, image, 0.5, 1.0, points, points)
    cuda.apss(points, points, None, image, 5.0, 300)
    cuda.apss(points, points, torch.stack([points, points]), image, 5.0, 300)
    return sorted(compiled)


if __name__ == "__main__":
    print(*compile_all())
