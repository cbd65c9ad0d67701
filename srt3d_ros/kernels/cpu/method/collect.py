"""The list of points of a reconstruction: xyz = ray · (metres_per_bin · t + metres)."""

import numpy as np


def collect(depth, intensity, std, rays, metres_per_bin, metres, num_bins):
    rows, surfaces, cols = intensity.shape
    layer = (surfaces * cols * np.arange(rows)[:, None] + np.arange(cols)).reshape(-1)      # each pixel's first surface
    if surfaces > 1:            # the strongest first; of equals the one with the lower index
        order = np.argsort(-intensity, axis=1, kind="stable").swapaxes(1, 2).reshape(-1, surfaces)
        layer = (layer[:, None] + order * cols).reshape(-1)
    place = np.flatnonzero(intensity.take(layer))
    (pixel, rank), at = np.divmod(place, surfaces), layer[place]
    row, col = np.divmod(pixel, cols)
    depth = depth.take(at)
    depth[depth >= num_bins] = 0                                # rounded up to T
    values = np.stack([depth, intensity.take(at), std.take(at)])
    xyz = rays.reshape(-1, 3).take(pixel, axis=0) * (depth.astype(float) * metres_per_bin + metres)[:, None]
    return row.astype(np.uint16), col.astype(np.uint16), rank.astype(np.uint8), values, xyz.astype(np.float32)
