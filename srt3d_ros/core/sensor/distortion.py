"""PlumbBob: lens distortion, and its inverse."""

from dataclasses import astuple, dataclass
from typing import Annotated

import numpy as np

from srt3d_ros.core.keys import Key, documented, numbers
from srt3d_ros.errors import InvalidInput
from srt3d_ros.kernels.lens import distorted

PATH_STEPS = 4              # from the image centre to a pixel: keeps Newton's method on one branch
NEWTON_ITERATIONS = 30      # in each step, at most; 3 to 6 suffice where there is a solution
PRECISION = 1e-12           # of the solution, relative to the focal length
SAMPLES = 64                # between the centre and a pixel, at which the model must be invertible


@documented
@dataclass(frozen=True)
class PlumbBob:
    """Radial and tangential distortion, `plumb_bob` of sensor_msgs/CameraInfo and OpenCV.

    The ray (x, y, 1) is seen at col = fx · x' + cx, row = fy · y' + cy, where r² = x² + y²,

        x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²),
        y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y

    (D. C. Brown, Close-range camera calibration, Photogrammetric Engineering 37 (8), 1971). Refused if some pixel then
    sees no ray, or two.
    """

    k1: Annotated[float, Key("radial", "1", needed=True)] = 0.0
    k2: Annotated[float, Key("radial", "1", needed=True)] = 0.0
    p1: Annotated[float, Key("tangential", "1", needed=True)] = 0.0
    p2: Annotated[float, Key("tangential", "1", needed=True)] = 0.0
    k3: Annotated[float, Key("radial", "1")] = 0.0

    def __post_init__(self):
        numbers(self, "projection.distortion.")

    def __bool__(self) -> bool:
        """True if any coefficient is not 0."""
        return any(astuple(self))

    @property
    def reach(self) -> float:
        """x² + y² of the rays at which the radial model turns back; it does not hold for wider rays."""
        roots = np.roots([7 * self.k3, 5 * self.k2, 3 * self.k1, 1])        # of d radius' / d radius, in x² + y²
        return float(min(roots[(roots.imag == 0) & (roots.real > 0)].real, default=np.inf))

    def undistorted(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The (x, y) of the rays (x, y, 1) that are seen at these (x', y'), float64; InvalidInput where none is."""
        at_x, at_y, left = np.zeros(np.shape(x)), np.zeros(np.shape(y)), np.ones(np.shape(x), bool)
        with np.errstate(all="ignore"):         # diverging rays are refused below
            for share in np.arange(1, PATH_STEPS + 1) / PATH_STEPS:
                at_x, at_y, left = self._newton(at_x, at_y, x * share, y * share)
        self._refuse(left, x, y)
        return at_x, at_y

    def check(self, x: np.ndarray, y: np.ndarray) -> None:
        """Raise InvalidInput unless the model is invertible between (0, 0) and each (x', y') [N].

        Polynomials turn back outside the image that they were fitted to. Two rays then share a place, and Newton's
        method may find either.
        """
        at_x, at_y = self.undistorted(x, y)
        share = np.linspace(0, 1, SAMPLES)[:, None]
        with np.errstate(all="ignore"):
            xx, xy, yy = self._slopes(at_x * share, at_y * share)
            self._refuse(np.asarray(~((xx * yy > xy * xy) & (xx + yy > 0)).all(axis=0)), x, y)

    def _newton(self, x: np.ndarray, y: np.ndarray, wanted_x: np.ndarray, wanted_y: np.ndarray):
        """The solution by Newton's method from (x, y), and a mask of where it did not converge."""
        left = np.ones(np.shape(x), bool)
        for _ in range(NEWTON_ITERATIONS):
            seen_x, seen_y = distorted(x, y, *astuple(self))
            off_x, off_y = wanted_x - seen_x, wanted_y - seen_y
            xx, xy, yy = self._slopes(x, y)
            scale = 1 / (xx * yy - xy * xy)
            step_x, step_y = (yy * off_x - xy * off_y) * scale, (xx * off_y - xy * off_x) * scale
            x, y = x + step_x, y + step_y
            left = ~(np.maximum(abs(step_x), abs(step_y)) <= PRECISION * (1 + abs(x) + abs(y)))     # NaN too
            if not left.any():
                break
        return x, y, left

    def _slopes(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """∂x'/∂x, ∂x'/∂y = ∂y'/∂x, and ∂y'/∂y."""
        r2 = x * x + y * y
        radial = 1 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        growth = 2 * (self.k1 + r2 * (2 * self.k2 + r2 * 3 * self.k3))
        return (radial + growth * x * x + 2 * self.p1 * y + 6 * self.p2 * x,
                growth * x * y + 2 * self.p1 * x + 2 * self.p2 * y,
                radial + growth * y * y + 6 * self.p1 * y + 2 * self.p2 * x)

    def _refuse(self, wrong: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
        if wrong.any():
            coefficients = ", ".join(f"{name} {value:g}" for name, value in vars(self).items())
            raise InvalidInput("projection.distortion", coefficients, "a model that shows one ray at each pixel; this "
                               f"one does not at x' = {x[wrong][0]:.3g}, y' = {y[wrong][0]:.3g} (in focal lengths from "
                               "the principal point)")
