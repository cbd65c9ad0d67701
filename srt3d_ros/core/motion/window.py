"""MovingWindow: adds up the frames of a sensor, each moved to where its photons would be seen from now.

A frame of age k has the weight f^k, f = (W − 1) / (W + 1). So the sum is moved once a frame, for any W; it has the mean
age and the noise of W frames of equal weight. Of a pixel that has seen frames of weights w_k,

    E₁ = Σ w_k,    E₂ = Σ w_k²,    exposure E₁² / E₂:

sums and photons times E₁ / E₂ have the mean and the variance of so many frames, so they count as photons. The two move
with the sums, from pixels without a photon as well: what has come into view has been seen by fewer frames.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.motion.deskew import Deskewer
from srt3d_ros.core.motion.trajectory import Trajectory
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sums import PhaseSums


class MovingWindow:
    """The frames that have come, as one sketch at the instant of the newest.

    Args:
        sensor, frequencies: of the sketches.
        frames: W, 1 or more.
    """

    def __init__(self, sensor: SensorModel, frequencies: Sequence[int], frames: int):
        self._deskewer, self._share = Deskewer(sensor, frequencies), np.float32((frames - 1) / (frames + 1))
        self.forget()

    def forget(self) -> None:
        """Begin a new window."""
        self._before: _Sum | None = None

    def __call__(self, sketch: PhaseSums, trajectory: Trajectory | None, cloud: PointCloud | None) -> PhaseSums:
        """The sketch of the window that ends with this frame; its `exposure` is in frames.

        Args:
            sketch: of one frame, as seen at its stamp.
            trajectory: of the sensor; None if it is at rest. One that does not cover the time since the last frame
                begins a new window, as a frame does that has `before` and the last one not, or the other way round.
            cloud: of the last frame; tells the ranges. Without one, the photons do.
        """
        m, own, exposure = len(sketch.frequencies), _with_exposure(sketch), np.ones(sketch.photons.shape, np.float32)
        before = self._before
        if before is not None and before.sums.shape != own.shape:
            before = None       # one of both does not know the photons before the gate
        if before is not None and trajectory is not None:
            goes_on = before.stamp_ns < sketch.stamp_ns and trajectory.covers(before.stamp_ns, sketch.stamp_ns)
            before = self._moved(before, sketch, trajectory, cloud) if goes_on else None
        parts = own.view(np.float32)                # real and imaginary ones
        if before is not None:
            of_before = before.sums.view(np.float32)
            of_before *= self._share
            of_before[..., 2 * m + 1] *= self._share        # E₂: f²
            parts += of_before
            exposure += self._share * before.exposure
        self._before = _Sum(sketch.stamp_ns, own, exposure)
        counts, squares, *gated = np.moveaxis(parts[..., 2 * m:], 2, 0)
        scale = exposure / squares
        sums, photons = self._deskewer.whole(own[..., :m], counts, scale)
        gated = np.rint(gated[0] * scale).astype(np.uint32) if gated else None
        return replace(sketch, sums=sums, photons=photons, before=gated, exposure=exposure * scale)

    def _moved(self, before: "_Sum", sketch: PhaseSums, trajectory: Trajectory, cloud: PointCloud | None) -> "_Sum":
        """The frames before, where they are seen from now."""
        now_ns, deskewer = sketch.stamp_ns, self._deskewer
        pose = trajectory.at(now_ns).inverse() @ trajectory.at(before.stamp_ns)
        ranges = None if cloud is None else deskewer.ranges_of(cloud, pose)
        if ranges is None:
            ranges = deskewer.ranges_m([(now_ns, sketch)])
        return _Sum(now_ns, *deskewer.moved([(pose, before.sums, before.exposure)], ranges))


class _Sum(NamedTuple):
    """Weighted sums of frames at an instant, as of `_with_exposure`; and E₁, float32 [rows, cols]."""

    stamp_ns: int
    sums: np.ndarray
    exposure: np.ndarray


def _with_exposure(sketch: PhaseSums) -> np.ndarray:
    """Sums, n + i E₂ and, behind a gate, the photons before it, complex64 [rows, cols, m + 1 or m + 2]."""
    before = () if sketch.before is None else (sketch.before[..., None],)
    return np.concatenate([sketch.sums, (sketch.photons + 1j)[..., None], *before], axis=2, dtype=np.complex64,
                          casting="same_kind")
