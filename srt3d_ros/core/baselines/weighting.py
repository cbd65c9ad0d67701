"""Tabulates gradient steps with the weighting W of the sketched data term (SRT3D, ICASSP 2022, eq. 6).

The data term is n (z − Ψ_θ)ᵀ W (z − Ψ_θ), real and imaginary parts stacked, with W the identity or Σ_θ⁻¹, the inverse
covariance of one photon's sketch. Turned back by exp(−i ω_l t), residual and covariance depend on the share α of signal
photons only, not on the depth. So steps are tabulated over α, and weighting costs no time.
"""

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import angular_frequencies, irf_spectrum

SHARES = 65             # values of α from 0 to 1
COVARIANCE_RIDGE = 1e-3     # of the mean variance: short IRFs give all photons of a surface the same sketch


def weighted_steps(sensor: SensorModel, frequencies, precise: bool) -> np.ndarray:
    """A = (Uᵀ W U)⁻¹ Uᵀ W for every share α, which turns a residual into the errors of r · t and r.

    U has the derivatives of the expected sketch: i ω_l ĥ_l for a shift, ĥ_l for a change of intensity. A is the
    Gauss-Newton step on the data term: its gradient, divided by its curvature.

    Args:
        precise: W is the inverse covariance, else the identity.

    Returns:
        float32 [SHARES, or 1 for the identity, 4, m]: weights of the real and the imaginary parts of the residual of
        `MatchedFrame.matched`, conj(ĥ_l) · sums_l, for r · t and then for r.
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
    """Σ of one photon's matched sketch, turned back by its surface's depth, for SHARES shares of signal.

    A photon is signal with probability α, else uniform over the bins, so E exp(i ω x) = α ĥ(ω) for ω ≠ 0 and 1 for 0.
    Products of cosines and sines are sums of those at ω_l ± ω_n. Sensors with an IRF per pixel use the mean IRF.

    Returns:
        float64 [SHARES, 2m, 2m], real parts first.
    """
    sensor = sensor.replace(irf=sensor.mean_irf)
    k = np.asarray(frequencies)
    spectrum = irf_spectrum(sensor, k)
    share = np.linspace(0, 1, SHARES)[:, None, None]
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
    scale = np.tile(np.abs(spectrum), 2) + 1e-6         # relative to each frequency, else weak ones vanish
    mean = np.diagonal(covariance, axis1=1, axis2=2) @ (1 / scale**2) / len(scale)
    return covariance + np.maximum(COVARIANCE_RIDGE * mean, COVARIANCE_RIDGE**2)[:, None, None] * np.diag(scale**2)
