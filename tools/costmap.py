"""Draw docs/images/costmap.png: what voxels keep of a person who crossed a corridor, cleared by points, and by free.

    python -m tools.costmap docs/images/costmap.png
"""

import sys

import numpy as np
from matplotlib import pyplot

import srt3d_ros
from srt3d_ros.core.sensor.projection import Pinhole

SENSOR = srt3d_ros.Sensor(64, 64, 1000, 1e-10, np.exp(-np.arange(-16, 17)**2 / 32),
                          projection=Pinhole.from_fov(64, 64, 50))
VOXEL_M, CORNER_M, SHAPE = 0.1, np.array([-2.5, -0.75, 0.0]), (50, 15, 80)      # right, down, forward


def main() -> None:
    rng, maps = np.random.default_rng(0), np.zeros((2, *SHAPE), bool)
    reconstruct = stream = None
    for k in range(36):
        sketch = photons(rng, k, -1.4 + 0.1 * k).sketch(frequencies=(1, 2, 3, 5, 8, 12, 18, 26))
        reconstruct = reconstruct or srt3d_ros.Reconstructor(SENSOR, sketch.frequencies, device="cpu")
        stream = stream or srt3d_ros.FreeSpaceStream(SENSOR, sketch.frequencies)
        cloud = reconstruct(sketch)
        ends = (SENSOR.rays * stream(sketch, cloud, brightness=60)[..., None]).reshape(-1, 3)
        for voxels, rays in zip(maps, (cloud.xyz, np.concatenate([cloud.xyz, ends[np.isfinite(ends[:, 0])]]))):
            range_m = np.linalg.norm(rays, axis=1, keepdims=True)
            for at_m in np.arange(0, 8, VOXEL_M / 2):       # up to two voxels before the end, as Nav2's VoxelLayer
                fill(voxels, (rays * at_m / range_m)[range_m[:, 0] > at_m + 2 * VOXEL_M], False)
            fill(voxels, cloud.xyz, True)
    figure = pyplot.figure(figsize=(6.4, 4.8), layout="constrained")
    for ax, voxels, title in zip(figure.subplots(1, 2, sharey=True), maps, ("points clear", "points and free clear")):
        ax.imshow(voxels.any(axis=1).T, origin="lower", cmap="Greys", extent=(-2.5, 2.5, 0, 8))
        ax.annotate("", (1.6, 2.6), (-1.6, 2.6), arrowprops={"arrowstyle": "->", "color": "tab:orange"})
        ax.text(0, 2.35, "a person passed", color="tab:orange", ha="center", va="top")
        ax.plot(0, 0.15, "^", color="tab:blue")
        ax.text(0.15, 0.1, "sensor", color="tab:blue")
        ax.set(title=title, xlabel="metres to the right", ylabel="metres ahead")
        ax.label_outer()
    figure.savefig(sys.argv[1], dpi=110)


def photons(rng: np.random.Generator, k: int, person_m: float) -> srt3d_ros.Photons:
    """Frame k of a corridor that is open at its end; a person stands in it, 3 m ahead, in frames 4 to 31."""
    right, down, ahead = np.moveaxis(SENSOR.rays, 2, 0)
    range_m = np.minimum(0.8 / np.maximum(down, 1e-9), 1.9 / np.maximum(np.abs(right), 1e-9))      # floor and walls
    at_m = 3 / ahead
    range_m[(np.abs(right * at_m - person_m) < 0.25) & (down * at_m > -0.9) & (at_m < range_m) & (4 <= k < 32)] = 3
    counts = rng.poisson(1e-3, (SENSOR.pixels, SENSOR.num_bins))
    signal = rng.poisson(np.where(range_m < 9, 400 / range_m**2, 0)).ravel()
    depth = np.rint(rng.normal(np.repeat(SENSOR.depth_bins(np.minimum(range_m, 9)).ravel(), signal), 4)).astype(int)
    np.add.at(counts, (np.repeat(np.arange(SENSOR.pixels), signal), depth), 1)
    return srt3d_ros.from_counts(counts.reshape(64, 64, -1), sensor=SENSOR, stamp_ns=(k + 1) * 10**8)


def fill(voxels: np.ndarray, xyz: np.ndarray, value: bool) -> None:
    at = np.floor((xyz - CORNER_M) / VOXEL_M).astype(int)
    voxels[tuple(at[((at >= 0) & (at < SHAPE)).all(axis=1)].T)] = value


if __name__ == "__main__":
    main()
