"""Motion of a sensor from its photons alone: the twist under which they fall on the surfaces of the last cloud.

Parts of a frame have too few photons for a cloud of their own, but enough to say whether they fit one. With
ξ = (ω, v), the sensor's turn and speed from the cloud to the frame's end, this climbs

    F(ξ) = Σ_parts Σ_pixels Re Σ_l conj(ĥ_l) g_l sums_l exp(−i ω_l t(ξ)),     g_l = exp(−ω_l² s² / 2),

the matched filter of every pixel at the depth t that the last cloud predicts for it: where its ray meets the tangent
plane of the surface there, seen from where the sensor was. Projective association and point-to-plane distances are
those of Blais and Levine (PAMI 1995) and KinectFusion (ISMAR 2011), with photons in the place of points. The filter is
blurred over s bins, from wide to narrow, so that the start may be some IRF widths off. What moves by itself is further
from the prediction than the filter is wide, and pulls at nothing.

Within a frame the sensor moves on the parabola through the poses at its ends and one as long before.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from srt3d_ros.core.deskew import Parts, pixels_of
from srt3d_ros.core.frequencies import angular_frequencies
from srt3d_ros.core.matched_frame import Matcher
from srt3d_ros.core.motion import Pose, Trajectory
from srt3d_ros.core.moving_sketcher import MovingFrame
from srt3d_ros.core.sensor import SensorModel

BLURS = (2, 2, 2, 1, 1, 1, 1)   # s of each step, in widths of the filter's peak; fewer steps leave more of the motion
FROM_REST = (8, 8, 8, 4, 4, 4)  # before those while the last twist is not known
STEPS_A_BIN = 8                 # of the table of phases: depths rounded to it are wrong by less than 1 % of an IRF
POINTS = 5000                   # of the cloud that are followed; more cost time and gain less than the noise of planes
PARTS = 5                       # into which a frame's are put together: as many instants describe an even motion
SMOOTHING = 2                   # pixels to each side over which the cloud is averaged, and planes are laid
JUMP = 0.1                      # of the range, from pixel to pixel of a plane's: more is an edge
GRAZING = 0.15                  # cosine between ray and normal below which a plane's depth is too uncertain
CHANGE = 0.5                    # rad/s and m/s by which the twist may differ from the last one's, standard deviation
LARGEST = 3.0                   # rad/s and m/s of a twist that is believed
LIT = 0.5                       # of the photons are from surfaces, to begin with
LEAST = 0.2                     # of the curvature that they would have, below which what a step shows is chance
BENDS = 8                       # poses of a frame
SURE = 5.0                      # standard deviations by which photons have to fit the cloud better than by chance


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Points of a cloud with the planes through them, in the sensor's frame at `stamp_ns`; float32 [N, 3] each."""

    stamp_ns: int
    points: np.ndarray
    normals: np.ndarray

    @classmethod
    def of_ranges(cls, stamp_ns: int, range_m: np.ndarray, sensor: SensorModel) -> "Surfaces":
        """Those of a range image [rows, cols], metres along the rays, NaN = unknown; at most POINTS, evenly spread."""
        xyz = _smoothed(range_m, sensor.rays)
        right, down = np.full_like(xyz, np.nan), np.full_like(xyz, np.nan)
        right[:, 1:-1], down[1:-1] = xyz[:, 2:] - xyz[:, :-2], xyz[2:] - xyz[:-2]
        normals = np.cross(right, down)
        with np.errstate(invalid="ignore", divide="ignore"):
            normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
            facing = np.abs((normals * sensor.rays).sum(axis=-1)) > GRAZING
            steps = np.maximum(np.linalg.norm(right, axis=-1), np.linalg.norm(down, axis=-1))
            kept = np.flatnonzero(facing & (steps < 2 * JUMP * np.linalg.norm(xyz, axis=-1)))
        kept = kept[::max(-(-len(kept) // POINTS), 1)]
        return cls(stamp_ns, xyz.reshape(-1, 3)[kept], normals.reshape(-1, 3)[kept])


class MotionEstimator:
    """Finds the motion of one sensor, frame after frame.

    Args:
        sensor: geometry, IRF and calibration of the sketches.
        frequencies: the integers k_l of the sketches.

    Attributes:
        trajectory: from the first cloud on, in its frame; begins anew after a frame that fits no cloud.
        twist: ω in rad/s and v in m/s of the last frame, in the sensor's frame at the cloud; float64 [6].
    """

    def __init__(self, sensor: SensorModel, frequencies):
        self._sensor, self._matcher = sensor, Matcher(sensor, frequencies)
        self._omega = angular_frequencies(frequencies, sensor.num_bins)
        energy = self._matcher.energy.astype(np.float64)
        self._width = float(np.sqrt(energy.sum() / (energy * self._omega**2).sum()))
        self.forget()

    def forget(self) -> None:
        """Begin anew, with a sensor at rest."""
        self.trajectory, self.twist, self._change, self._known = Trajectory(), np.zeros(6), np.zeros(6), False

    def follow(self, surfaces: Surfaces, frame: MovingFrame) -> Trajectory | None:
        """The trajectory up to the end of a frame; None if its photons do not fit the surfaces.

        Args:
            surfaces: of the last cloud that has come, of one of the frames before.
        """
        first_ns, last_ns, stamp_ns = frame.first_ns, frame.last_ns, surfaces.stamp_ns
        if not self.trajectory.covers(stamp_ns, stamp_ns):
            self.trajectory = Trajectory()
            self.trajectory.add(stamp_ns, Pose())
        twist = self(surfaces, frame.parts) if last_ns > self.trajectory.newest_ns else None
        if twist is None:
            self.forget()
            return None
        start = self.trajectory.at(stamp_ns)
        if first_ns > self.trajectory.newest_ns:
            self.trajectory.add(first_ns, start @ _moved(twist, (first_ns - stamp_ns) / 1e9))
        if last_ns >= self.trajectory.newest_ns + BENDS:        # not so if the frame is an instant
            self._go_on(last_ns, start @ _moved(twist, (last_ns - stamp_ns) / 1e9))
        return self.trajectory if self.trajectory.covers(first_ns, last_ns) else None

    def _go_on(self, to_ns: int, pose: Pose) -> None:
        """Add a pose, and before it some of an even acceleration."""
        from_ns = self.trajectory.newest_ns
        begin, before_ns = self.trajectory.at(from_ns), 2 * from_ns - to_ns
        motion, bend = _twist(begin.inverse() @ pose), np.zeros(6)
        if self.trajectory.covers(before_ns, from_ns):
            bend = motion - _twist(self.trajectory.motion(from_ns, before_ns))
        for share in np.arange(1, BENDS + 1) / BENDS:
            self.trajectory.add(from_ns + round(share * (to_ns - from_ns)),
                                begin @ _moved(motion - (1 - share) / 2 * bend, share))

    def __call__(self, surfaces: Surfaces, parts: Parts) -> np.ndarray | None:
        """The twist from the cloud's instant on, float64 [6]; None if the photons do not fit the cloud.

        Args:
            surfaces: of the last cloud.
            parts: instant, ns, and sketch of each part of the frame.
        """
        if not len(surfaces.points):
            return None
        seen = self._put_together(surfaces.stamp_ns, parts)
        begin = self.twist + self._change
        twist, last, blurred = begin, None, None
        for blur in BLURS if self._known else FROM_REST + BLURS:
            if blur != blurred:
                matched, blurred, last = self._filters(seen, blur * self._width), blur, None
            score, noise, gradient, curvature = self._look(surfaces, seen, matched, twist)
            gradient = gradient + (begin - twist) / CHANGE**2
            if last is None:
                curvature = curvature * LIT * self._sharpness(blur * self._width) + np.eye(6) / CHANGE**2
                inverse = np.linalg.inv(curvature)
            else:
                inverse = _bfgs(inverse, curvature, twist - last[0], last[1] - gradient)
            last, twist = (twist, gradient), twist + inverse @ gradient
        known = bool(score > SURE * noise and np.abs(twist).max() < LARGEST)
        self._change = twist - self.twist if known and self._known else np.zeros(6)
        self.twist, self._known = twist if known else np.zeros(6), known
        return twist if known else None

    def _put_together(self, stamp_ns: int, parts):
        """At most PARTS parts: seconds since the cloud, sums [pixels, m] and photons [pixels] of each."""
        groups = np.array_split(np.arange(len(parts)), min(PARTS, len(parts)))
        found = [((np.mean([parts[k][0] for k in group]) - stamp_ns) / 1e9,
                  sum(parts[k][1].sums for k in group).reshape(self._sensor.pixels, -1),
                  sum(parts[k][1].photons.astype(np.float32) for k in group).reshape(-1)) for group in groups]
        return found if self._sensor.pixel_times_s is None else self._by_pixel_times(*found[0])

    def _by_pixel_times(self, start_s: float, sums: np.ndarray, photons: np.ndarray):
        """A scanner's frame, whose pixels look one after the other: in parts by their times."""
        times_s = self._sensor.pixel_times_s.reshape(-1)
        parts = []
        for pixels in np.array_split(np.argsort(times_s, kind="stable"), PARTS):
            own = np.zeros(len(times_s), np.float32)
            own[pixels] = 1
            parts.append((start_s + float(times_s[pixels].mean()), sums * own[:, None], photons * own))
        return parts

    def _filters(self, seen, blur_bins: float) -> list[np.ndarray]:
        """Of each part, the sums matched and blurred; float32 [pixels, 2m]."""
        window = (self._matcher.equaliser * np.exp(-(self._omega * blur_bins)**2 / 2)).astype(np.complex64)
        window = window.reshape(-1, len(self._omega))
        return [np.ascontiguousarray(sums * window).view(np.float32) for _, sums, _ in seen]

    def _sharpness(self, blur_bins: float) -> float:
        """Curvature of the blurred filter at its peak, of one photon."""
        return float(self._matcher.energy @ (self._omega**2 * np.exp(-(self._omega * blur_bins)**2 / 2)))

    @cached_property
    def _phases(self) -> np.ndarray:
        """cos and sin of ω_l t at every STEPS_A_BIN-th of a bin; float32 [8 T, 2m]."""
        turns = np.outer(np.arange(self._sensor.num_bins * STEPS_A_BIN) / STEPS_A_BIN, self._omega)
        return np.exp(1j * turns).astype(np.complex64).view(np.float32)

    def _look(self, surfaces: Surfaces, seen, matched, twist):
        """F and the standard deviation that it has by chance, its gradient in ξ, and its curvature over `_sharpness`,
        if all photons fit."""
        sensor, rays = self._sensor, self._sensor.rays.reshape(-1, 3)
        score, variance, gradient, curvature = 0.0, 0.0, np.zeros(6), np.zeros((6, 6))
        weights = np.repeat(self._omega, 2).astype(np.float32)
        for (elapsed_s, _, photons), filters in zip(seen, matched, strict=True):
            back = _moved(twist, elapsed_s).inverse()
            rotation = back.rotation.astype(np.float32)
            points = surfaces.points @ rotation.T + back.translation.astype(np.float32)
            normals = surfaces.normals @ rotation.T
            pixel, kept = pixels_of(sensor, points)
            points, normals = points[kept], normals[kept]
            cosine = (rays[pixel] * normals).sum(axis=1)
            kept = np.abs(cosine) > GRAZING
            pixel, points, normals, cosine = pixel[kept], points[kept], normals[kept], cosine[kept]
            range_m = (points * normals).sum(axis=1) / cosine
            depth = sensor.depth_bins(range_m)
            phases = self._phases[np.rint(depth * STEPS_A_BIN).astype(np.int64) % len(self._phases)]
            filters = filters[pixel]
            score += float(np.einsum("ij,ij->", filters, phases))
            # d/dt Re(S e^{-iωt}) = ω (S_im cos − S_re sin)
            slope = np.einsum("ij,ij,j->i", filters[:, 1::2], phases[:, ::2], weights[::2])
            slope -= np.einsum("ij,ij,j->i", filters[:, ::2], phases[:, 1::2], weights[::2])
            # a plane's points move by −dt (v + ω × y), its depth along a ray by as much along the normal
            lever = np.concatenate([np.cross(points, normals), normals], axis=1)
            lever *= (-elapsed_s / sensor.bin_width_m / cosine)[:, None]
            gradient += lever.T @ slope
            number = photons[pixel]
            curvature += (lever * number[:, None]).T @ lever
            variance += float(number.sum())
        return score, np.sqrt(variance / 2 * self._matcher.energy.sum()), gradient, curvature


def _moved(twist: np.ndarray, elapsed_s: float) -> Pose:
    """Pose after some time at a twist, in the frame of its beginning."""
    return Pose(Pose.turned(twist[:3] * elapsed_s).rotation, twist[3:] * elapsed_s)


def _twist(motion: Pose) -> np.ndarray:
    """That of which `_moved` makes this motion in a second."""
    return np.concatenate([motion.rotation_vector, motion.translation])


def _bfgs(inverse: np.ndarray, curvature: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The inverse curvature after a step over which the gradient fell by `change` (Broyden, 1970).

    Noise in the normals makes the curvature too large where little is known, and steps too short there.
    """
    along = float(step @ change)
    if along <= LEAST * (step @ curvature @ step):
        return inverse
    left = np.eye(6) - np.outer(step, change) / along
    return left @ inverse @ left.T + np.outer(step, step) / along


def _smoothed(range_m: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Mean of the points near each that are not beyond an edge, which lies on their plane; NaN if it is unknown."""
    rows, cols = range_m.shape
    near = SMOOTHING
    ranges = np.pad(range_m, near, constant_values=np.nan)
    points = np.nan_to_num(ranges)[..., None] * np.pad(rays, ((near, near), (near, near), (0, 0)))
    total, number = np.zeros_like(rays), np.zeros_like(range_m)
    for row in range(2 * near + 1):
        for col in range(2 * near + 1):
            part = slice(row, row + rows), slice(col, col + cols)
            with np.errstate(invalid="ignore"):
                inside = np.abs(ranges[part] - range_m) < JUMP * range_m
            total += points[part] * inside[..., None]
            number += inside
    return np.where(number[..., None] > 0, total / np.maximum(number, 1)[..., None], np.float32(np.nan))
