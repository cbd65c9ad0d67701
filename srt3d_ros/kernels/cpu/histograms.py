"""Histograms → sketch: a product of matrices, by BLAS, with its threads."""

import numpy as np

from srt3d_ros.kernels.cpu.rows import UNIT

ROWS = 2**7         # histograms at a time: of 2⁵ to 2⁹ these were fastest for 4,613 bins


def sketch_histograms(counts, table, of_template, sums, photons):
    """sums_i += Σ_j counts_ij table_j − of_template, and its last column but one, if above 0, to photons_i.

    In float32: what it costs does not depend on the counts. `sums` may be of 2m values only, then what is behind them
    counts for `photons` alone.

    Args:
        counts: uint8, uint16, int32 or float32 [pixels, n].
        table: float32 [n, 2m + 2] of exp(i ω_l b), re and im interleaved, then 1 and 0; zeros for bins that do not
            count.
        of_template: float32 [2m + 2] or [pixels, 2m + 2], or None.
    """
    pixels, n = counts.shape
    wanted = min(sums.shape[1], table.shape[-1])
    as_float = np.empty((min(ROWS, pixels), n), np.float32)         # a part in the cache instead of a frame in memory
    for first in range(0, pixels, ROWS):
        part = slice(first, min(first + ROWS, pixels))
        of_part = as_float[:part.stop - first]
        of_part[:] = counts[part]
        product = of_part @ table
        if of_template is not None:
            product -= of_template if of_template.ndim == 1 else of_template[part]
        sums[part, :wanted] += np.rint(product[:, :wanted] * np.float64(UNIT)).astype(np.int64)
        photons[part] += np.rint(np.maximum(product[:, -2], 0)).astype(np.int64)
