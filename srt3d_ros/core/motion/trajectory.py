"""Pose and Trajectory: rigid motions, and their interpolation over time."""

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from srt3d_ros.errors import InvalidInput, require

KEPT_NS = 10 * 10**9        # of a trajectory: longer than frames wait for motion
SMOOTH_NS = 150_000_000     # each way: stamps off by 20 ms err by 4 mm at 1 m/s; 1 mm of a hand's tremor is lost
FEWEST = 6                  # poses that a parabola is fitted to


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid motion: x' = rotation · x + translation. As a pose: from the sensor's frame to a fixed one.

    Args:
        rotation: float64 [3, 3], orthonormal.
        translation: float64 [3], metres.
    """

    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    translation: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def from_quaternion(cls, xyzw: ArrayLike, translation: ArrayLike = (0, 0, 0)) -> Self:
        """The pose of a quaternion (x, y, z, w), as in ROS; InvalidInput unless finite and of length 1 ± 1 %."""
        quaternion = np.asarray(xyzw, np.float64)
        translation = np.asarray(translation, np.float64)
        require(bool(np.isfinite(translation).all()), "position", translation.tolist(), "finite metres")
        length = math.hypot(*quaternion)
        require(abs(length - 1) < 0.01, "orientation", quaternion.tolist(), "a quaternion of length 1")    # refuses NaN
        return cls(_rotations().from_quat(quaternion).as_matrix(), translation)

    @classmethod
    def from_text(cls, text: str) -> Self:
        """The pose of the text `x y z qx qy qz qw`, the identity if it is empty; InvalidInput for any other."""
        if not text.strip():
            return cls()
        try:
            x, y, z, *quaternion = map(float, text.replace(",", " ").split())
            require(len(quaternion) == 4, "extrinsics", text, "7 numbers")
            return cls.from_quaternion(quaternion, (x, y, z))
        except ValueError as problem:       # also InvalidInput
            raise InvalidInput("extrinsics", text, "x y z in metres and a quaternion qx qy qz qw of length 1, or "
                               "nothing") from problem

    @classmethod
    def turned(cls, rotation_vector: ArrayLike) -> Self:
        """A rotation by |v| radians about v."""
        return cls(_rotations().from_rotvec(rotation_vector).as_matrix())

    @property
    def rotation_vector(self) -> np.ndarray:
        """Axis times angle in radians, 0 to π; float64 [3]: the inverse of `turned`."""
        return _rotations().from_matrix(self.rotation).as_rotvec()

    @property
    def quaternion(self) -> tuple[float, ...]:
        """The rotation as (x, y, z, w), w ≥ 0, as in ROS: the inverse of `from_quaternion`."""
        return tuple(_rotations().from_matrix(self.rotation).as_quat(canonical=True).tolist())

    def inverse(self) -> Self:
        """The inverse motion."""
        return type(self)(self.rotation.T, -self.rotation.T @ self.translation)

    def __matmul__(self, other: Self) -> Self:
        """First `other`, then this."""
        return type(self)(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def __call__(self, xyz: np.ndarray) -> np.ndarray:
        """Points [..., 3], moved."""
        return xyz @ self.rotation.T + self.translation


class Trajectory:
    """Poses of a sensor in one fixed frame, in order of time, of the last KEPT_NS; interpolated in between.

    Poses and stamps are noisy. Where FEWEST poses lie within SMOOTH_NS of an instant, its pose is that of a parabola
    fitted to them (local quadratic regression: Cleveland, JASA 74, 1979, with weights 1 − u²).
    """

    def __init__(self) -> None:
        self._stamps_ns: list[int] = []
        self._poses: list[Pose] = []

    def add(self, stamp_ns: int, pose: Pose) -> None:
        """Append a pose; InvalidInput unless it is later than the last one."""
        if self._stamps_ns:
            require(stamp_ns > self._stamps_ns[-1], "stamp", stamp_ns, f"later than the last, {self._stamps_ns[-1]} ns")
        self._stamps_ns.append(stamp_ns)
        self._poses.append(pose)
        if self._stamps_ns[0] < stamp_ns - 2 * KEPT_NS:         # rarely, so cheap on average
            old = bisect_left(self._stamps_ns, stamp_ns - KEPT_NS)
            del self._stamps_ns[:old], self._poses[:old]

    def add_turn(self, stamp_ns: int, rate_rad_s: np.ndarray) -> None:
        """Append the last pose, turned since at this rate in the sensor's frame, as an IMU measures it."""
        if not self._stamps_ns:
            return self.add(stamp_ns, Pose())
        elapsed_s = (stamp_ns - self._stamps_ns[-1]) / 1e9
        return self.add(stamp_ns, self._poses[-1] @ Pose.turned(np.asarray(rate_rad_s) * elapsed_s))

    @property
    def newest_ns(self) -> int | None:
        """The stamp of the last pose; None without poses."""
        return self._stamps_ns[-1] if self._stamps_ns else None

    def covers(self, first_ns: int, last_ns: int) -> bool:
        """Whether poses are known from first_ns to last_ns."""
        return bool(self._stamps_ns) and self._stamps_ns[0] <= first_ns and last_ns <= self._stamps_ns[-1]

    def at(self, stamp_ns: int) -> Pose:
        """The pose at an instant; InvalidInput unless the trajectory covers it."""
        stamps = self._stamps_ns
        require(self.covers(stamp_ns, stamp_ns), "stamp", stamp_ns,
                f"within the trajectory, {stamps[0]} to {stamps[-1]} ns" if stamps else "none: there is no pose yet")
        after = bisect_left(stamps, stamp_ns)
        before = max(after - 1, 0)
        around = slice(bisect_left(stamps, stamp_ns - SMOOTH_NS), bisect_right(stamps, stamp_ns + SMOOTH_NS))
        if around.stop - around.start < FEWEST or 3 * (stamps[after] - stamps[before]) > SMOOTH_NS:
            around = slice(before, after + 1)           # too few, or in a gap: a straight line
        away, poses = (np.array(stamps[around]) - stamp_ns) / SMOOTH_NS, self._poses[around]
        powers = away ** np.arange(min(len(poses), 3))[:, None]
        weighted = powers * (1 - away**2 + 1e-9)
        share = np.linalg.solve(weighted @ powers.T, weighted)[0]        # weight of each pose at the instant
        middle = poses[int(np.abs(away).argmin())].rotation
        turn = share @ _rotations().from_matrix(middle.T @ np.stack([pose.rotation for pose in poses])).as_rotvec()
        return Pose(middle @ Pose.turned(turn).rotation, share @ np.stack([pose.translation for pose in poses]))


def _rotations():
    from scipy.spatial.transform import Rotation  # here: takes 0.1 s, and only moving sensors need it

    return Rotation
