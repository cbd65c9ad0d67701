"""The CUDA kernels compile for an H100: Triton's interpreter, which runs them in the other tests, takes more than that.

No GPU is needed. Triton is told that there is one, and asked to compile whatever the functions would launch.
"""

import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

KERNELS = {
    "apss": ["_apss"], "birth_death": ["_choose", "_list_undecided"], "gradients": ["_poisson"],
    "likelihood": ["_log_likelihood_ratio"], "match": ["_match"],
    "phase_sums": ["_count", "_find_stray", "_inspect_events", "_place", "_sum_rows", "_sum_waves"],
    "pooled_step": ["_coarsen", "_expand", "_step"], "search": ["_decide", "_pool_rows"],
    "trim": ["_drop", "_mark"]}


def test_kernels_compile_for_an_h100():
    pytest.importorskip("triton")
    environment = {name: value for name, value in os.environ.items() if name != "TRITON_INTERPRET"}
    run = subprocess.run([sys.executable, __file__], env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == [f"{module}.{name}" for module, names in KERNELS.items() for name in names]


def compile_all() -> list[str]:
    """Call every function and return the names of the kernels that it compiled."""
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
    for module in ("device", "phase_sums"):
        sys.modules[f"srt3d_ros.kernels.cuda.{module}"].DEVICE = "cpu"          # where the arguments lie

    m, surfaces, rows, cols = 10, 2, 4, 64
    shape = maps.padded_shape(rows, cols)
    arrays = {name: torch.zeros(size) for name, size in {
        "matched": (shape[0], 2 * m, shape[1]), "counts": shape, "exposure": shape, "energy": m, "bin_frequencies": m,
        "moments": 2, "intensity_moments": 2, "background_table": 257}.items()}
    data = SimpleNamespace(**arrays, num_bins=300, max_response=1.0, total_energy=5.0, curvature=0.1, clutter=None,
                           origin=(0, 0), resolution_bins=7.0, shape=(rows, cols))
    state = torch.zeros(shape[0], surfaces, maps.FIELDS, shape[1])
    cuda.match(torch.zeros(rows, 2 * m, cols), data.energy, data.bin_frequencies, 300, surfaces)
    terms = cuda.expand(data, state, cuda.Scratch())
    for radius in (3, maps.MARGIN):
        cuda.pooled_step(data, state, terms, 2.0, radius, 23.0, cuda.Scratch())
    cuda.log_likelihood_ratio(data, state, terms)
    cuda.birth_death(data, state[:, :1].contiguous(), terms[:, :1].contiguous(), 23.0)
    image = torch.zeros(rows, cols)
    for clutter in (None, torch.ones(300)):
        data.clutter = clutter
        cuda.trim(data, state, terms, 2.3, cuda.Scratch())
        for layer, (sigma, step) in enumerate(((0.0, 1), (6.0, 3))):
            cuda.search(data, data.matched, state, layer, sigma, step, 5.0, cuda.Scratch(), state if layer else None)
    points = torch.zeros(rows, surfaces, cols)
    photons = SimpleNamespace(starts=torch.zeros(rows * cols + 1, dtype=torch.int64), toa=image, irf=image, slope=image,
                              exposure=image, ref=1, information=1.0, num_bins=300)
    cuda.poisson(photons, image, 0.5, 1.0, points, points)
    cuda.apss(points, points, None, image, 5.0, 300)
    cuda.apss(points, points, torch.stack([points, points]), image, 5.0, 300)
    compile_sketching(cuda, torch, rows * cols)
    return sorted(compiled)


def compile_sketching(cuda, torch, pixels):
    table, (sums, photons) = cuda.fixed_rows(torch.zeros(300, 20)), cuda.new_sums(pixels, 20)
    pixel, toa = torch.zeros(1000, dtype=torch.uint32), torch.zeros(1000, dtype=torch.uint16)
    words = torch.zeros(9, pixels, dtype=torch.uint16)
    cuda.inspect_events(pixel, toa, pixels, 300)
    cuda.find_stray(words, 0, 300, 300)
    cuda.sketch_sorted(pixel, toa, table, sums, photons)
    cuda.sketch_unsorted(pixel, toa, table, sums, photons)
    cuda.sketch_gates(words, table, 0, 300, sums, photons)
    for ordered in (False, True):
        cuda.sketch_continuous(pixel, toa.to(torch.float32), (1, 2, 3), 300, ordered, sums, photons)


if __name__ == "__main__":
    print(*compile_all())
