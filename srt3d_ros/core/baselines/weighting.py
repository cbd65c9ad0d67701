"""The weighting W of the sketched data term (SRT3D, ICASSP 2022, eq. 6), as what a gradient step needs of it.

The data term is n (z − Ψ_θ)ᵀ W (z − Ψ_θ), real and imaginary parts stacked, with W the identity or Σ_θ⁻¹, the inverse
covariance of one photon's sketch. Turned back by exp(−i ω_l t), residual and covariance no longer depend on the depth
but on the share α of signal among the photons alone. So W is tabulated over α, and a weighted step costs no more.
"""

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import angular_frequencies, irf_spectrum

LEVELS = 65             # shares α from 0 to 1
RIDGE = 1e-3            # of the mean variance: for IRFs so short that all photons of a surface have one sketch


def weighted_steps(sensor: SensorModel, frequencies, precise: bool) -> np.ndarray:
    """A = (Uᵀ W U)⁻¹ Uᵀ W for every share α: turns a residual into the errors of r · t and r.

    U are the derivatives of the expected sketch: i ω_l ĥ_l for a shift, ĥ_l for a change of intensity. A is the
    Gauss-Newton step on the data term: its gradient, divided by its curvature.

    Args:
        precise: whether W is the inverse covariance, else the identity.

    Returns:
        float32 [LEVELS, or 1 for the identity, 4, m], for r · t, then for r, the weights of real and of imaginary parts
        of the residual of `MatchedFrame.matched`, conj(ĥ_l) · sums_l.
    """
    energy = (np.abs(np.atleast_2d(irf_spectrum(sensor, frequencies)))**2).mean(axis=0)
    zero = np.zeros_like(energy)
    derivatives = np.stack([np.concatenate([zero, angular_frequencies(frequencies, sensor.num_bins) * energy]),
                            np.concatenate([energy, zero])], axis=1)                             # U, [2m, 2]
    weights = np.linalg.inv(_covariances(sensor, frequencies)) if precise else \
        np.diag(1 / np.tile(np.maximum(energy, 1e-12), 2))[None]
    scores = derivatives.T @ weights                                                             # Uᵀ W
    steps = np.linalg.solve(scores @ derivatives, scores)                                        # A, [levels, 2, 2m]
    return np.ascontiguousarray(steps.reshape(len(steps), 4, len(energy)), dtype=np.float32)


def _covariances(sensor: SensorModel, frequencies) -> np.ndarray:
    """Σ of one photon's matched sketch, turned back by its surface's depth, for LEVELS shares of signal.

    A photon is signal with probability α, else uniform over the bins, so E exp(i ω x) = α ĥ(ω) for ω ≠ 0 and 1 for 0;
    products of cosines and sines are sums of those at ω_l ± ω_n. Of sensors with an IRF per pixel the mean IRF counts.

    Returns:
        float64 [LEVELS, 2m, 2m], real parts first.
    """
    if sensor.irf.ndim > 1:
        sensor = sensor.replace(irf=sensor.irf.mean(axis=0))
    k = np.asarray(frequencies)
    spectrum = irf_spectrum(sensor, k)
    share = np.linspace(0, 1, LEVELS)[:, None, None]
    plus, minus = (np.where(pairs % sensor.num_bins == 0, 1,
                            share * irf_spectrum(sensor, pairs.ravel()).reshape(pairs.shape))
                   for pairs in (k[:, None] + k, k[:, None] - k))
    # Of u = conj(ĥ) exp(i ω x): E u_l u_n and E u_l conj(u_n).
    plus = plus * np.conj(np.outer(spectrum, spectrum))
    minus = minus * np.outer(np.conj(spectrum), spectrum)
    energy = np.abs(spectrum)**2
    real = (minus + plus).real / 2 - share**2 * np.outer(energy, energy)
    imaginary = (minus - plus).real / 2
    mixed = (plus - minus).imag / 2                     # E Re u_l · Im u_n
    covariance = np.block([[real, mixed], [mixed.swapaxes(1, 2), imaginary]])
    scale = np.tile(np.abs(spectrum), 2) + 1e-6         # as for the sketch itself, else weak frequencies drown
    mean = np.diagonal(covariance, axis1=1, axis2=2) @ (1 / scale**2) / len(scale)
    return covariance + np.maximum(RIDGE * mean, RIDGE**2)[:, None, None] * np.diag(scale**2)
