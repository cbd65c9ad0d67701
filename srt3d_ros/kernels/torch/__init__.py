"""The kernels in torch, written to be read: the equations of what `kernels.contract` names.

`on` returns the functions for tensors of one type on one device. In double precision on the CPU they are the tests'
oracle, from which `cpu` differs by rounding only. In single precision they run on a GPU: each `fused` function is
compiled, and no step of a frame branches on a value, so that one CUDA graph holds a whole frame.

Sketching and moving sketches run on the CPU alone (`cpu.sketching`).

Notation:
    T            bins of a period (`num_bins`); depths are bins on a circle of T
    K, m         surfaces of a pixel, frequencies of a sketch; ω_l = 2π k_l / T
    x_p, n       times of arrival of a pixel's photons, bins, and their number
    h, ĥ_l       impulse response (IRF), and its spectrum Σ_b h(b) exp(i ω_l b)
    z_l          a pixel's matched sketch, conj(ĥ_l) · Σ_p exp(i ω_l x_p)
    t, r, g      depth (bins) and intensity (signal photons at g = 1) of a point, exposure of its pixel: the points of
                 a pixel are expected to show z_l = g Σ_k r_k |ĥ_l|² exp(i ω_l t_k)
    E, C         Σ_l |ĥ_l|² and Σ_l ω_l² |ĥ_l|²: curvature of the data term in r, and of that over r² in t (bins⁻²)
    δ            √(E / C), width of a matched filter's peak, bins (`resolution_bins`)
    R(z, t)      response to the matched filter, Σ_l Re(z_l exp(−i ω_l t))
    M₁, M₀       variance of dR/dt that a signal, a background photon adds (`moments`); I₁, I₀ of R itself
    M₂           what the width of bins adds to M₁ for a depth between two bins
    M₃           what it adds to the variance of the depth, bins²
    (·)₊, wrap   the positive part; a difference of depths on the circle, in [−T/2, T/2]
    ρ(u)         evidence of a mean response u of background photons, standard deviations per √photon
                 (`background_table`, Chernoff's bound)
    c(t)         factor by which scores at a depth exceed standard deviations (`clutter`)
    CAPITALS     constants of `kernels.constants` and `kernels.maps`
"""

import torch

from srt3d_ros.kernels.torch.baselines.apss import apss
from srt3d_ros.kernels.torch.baselines.gradients import median_depth, pixelwise, usual_intensity
from srt3d_ros.kernels.torch.device import Kernels
from srt3d_ros.kernels.torch.method.birth_death import birth_death
from srt3d_ros.kernels.torch.method.collect import collect
from srt3d_ros.kernels.torch.method.drops import drop_blobs, drop_ghosts, trim
from srt3d_ros.kernels.torch.method.finalise import background, drop_weak, finalise, local_mean
from srt3d_ros.kernels.torch.method.likelihood import log_likelihood_ratio
from srt3d_ros.kernels.torch.method.match import match
from srt3d_ros.kernels.torch.method.planes import turn_planes
from srt3d_ros.kernels.torch.method.pooled_step import pooled_step
from srt3d_ros.kernels.torch.method.search import no_surfaces, search
from srt3d_ros.kernels.torch.method.sketches import expand, prepare, residual, solve_pairs, unexplained
from srt3d_ros.kernels.torch.method.windows import blur

FUNCTIONS = {function.__name__: function for function in (
    apss, background, birth_death, blur, collect, drop_blobs, drop_ghosts, drop_weak, expand, finalise, local_mean,
    log_likelihood_ratio, match, median_depth, no_surfaces, pixelwise, pooled_step, prepare, residual, search,
    solve_pairs, trim, turn_planes, unexplained, usual_intensity)}


def on(device: str, dtype: torch.dtype = torch.float32) -> Kernels:
    """The kernels for real numbers of this type on a device, named as in torch."""
    return Kernels(FUNCTIONS, device, dtype)
