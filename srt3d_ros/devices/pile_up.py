"""Pile-up: a time-to-digital converter that keeps the first photon of a laser shot misses those behind it.

    P. B. Coates, "The correction for photon 'pile-up' in the measurement of radiative lifetimes", J. Phys. E 1, 1968.

Of N shots, N − C_b reach bin b without a photon, C_b being the counts of the bins before. So bin b sees photons at the
rate −ln(1 − c_b / (N − C_b)) a shot, and N times that is what a converter without dead time would have counted.
"""

import numpy as np

MOST = 0.999        # of the shots that reach a bin: beyond, the rate is anybody's guess


def corrected(counts: np.ndarray, shots: float) -> np.ndarray:
    """Counts without pile-up, float32 as `counts` [..., bins]; `shots` N may be infinite.

    Shots that are fewer than the counts of a pixel cannot be those of its converter; N is then as many as needed.
    """
    if not np.isfinite(shots):
        return counts.astype(np.float32)
    counts = counts.astype(np.float64)
    before = np.cumsum(counts, axis=-1) - counts
    shots = np.maximum(shots, (before[..., -1:] + counts[..., -1:]) / MOST)
    return (-shots * np.log1p(-np.minimum(counts / (shots - before), MOST))).astype(np.float32)


def shots(counts: np.ndarray, laser_bin: int) -> float:
    """N, told by the background: of its light the share 1 − S / N is left behind a pulse of S photons.

    Least squares of (rate before − rate behind) = rate before · S / N over the pixels.

    Args:
        counts: [pixels, bins], one converter a pixel, all with the same N.
        laser_bin: no laser light comes in the bins before it.

    Returns:
        N, or infinity if the background tells nothing: too dark, or no pulse.
    """
    ambient = counts[:, :laser_bin].mean(axis=1)
    behind = counts[:, -counts.shape[1] // 6:].mean(axis=1)        # far behind the pulse: its tail has ended
    pulse = ambient * np.maximum(counts.sum(axis=1) - counts.shape[1] * behind, 0)
    missing = float(((ambient - behind) * pulse).sum())
    # Photons of the background come by chance: N is known from what is missing to twice its standard deviation.
    spread = float(np.sqrt((pulse**2 * (ambient / laser_bin + behind / (counts.shape[1] // 6))).sum()))
    return float((pulse**2).sum()) / missing if missing > 2 * spread else np.inf
