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
        # 1 / (x² + y²) where d radius' / d radius = 0
        inverse = np.roots([1, 3 * self.k1, 5 * self.k2, 7 * self.k3])
        first = max(inverse[(inverse.imag == 0) & (inverse.real > 0)].real, default=0.0)
        return 1 / float(first) if first else np.inf

    def undistorted(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The (x, y) of the rays (x, y, 1) that are seen at these (x', y'), float64; InvalidInput where none is.

        By Newton's method, in steps from the centre to (x', y'). A solution counts if the model does not turn back
        between it and the centre.
        """
        at_x, at_y, found = np.zeros(np.shape(x)), np.zeros(np.shape(y)), np.zeros(np.shape(x), bool)
        with np.errstate(all="ignore"):         # diverging rays are refused below
            for share in np.arange(1, PATH_STEPS + 1) / PATH_STEPS:
                for _ in range(NEWTON_ITERATIONS):
                    seen_x, seen_y = distorted(at_x, at_y, *astuple(self))
                    off_x, off_y = share * x - seen_x, share * y - seen_y
                    xx, xy, yy = self._slopes(at_x, at_y)
                    scale = 1 / (xx * yy - xy * xy)
                    step_x, step_y = (yy * off_x - xy * off_y) * scale, (xx * off_y - xy * off_x) * scale
                    at_x, at_y = at_x + step_x, at_y + step_y
                    found = np.maximum(abs(step_x), abs(step_y)) <= PRECISION * (1 + abs(at_x) + abs(at_y))
                    if found.all():
                        break
            xx, xy, yy = self._slopes(at_x, at_y)
            found &= (xx * yy > xy * xy) & (xx + yy > 0) & (at_x**2 + at_y**2 < self.reach)
        if not found.all():
            coefficients = ", ".join(f"{name} {value:g}" for name, value in vars(self).items())
            raise InvalidInput("projection.distortion", coefficients, "a model that shows one ray at each pixel; this "
                               f"one does not at x' = {x[~found][0]:.3g}, y' = {y[~found][0]:.3g} (in focal lengths "
                               "from the principal point)")
        return at_x, at_y

    def _slopes(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """∂x'/∂x, ∂x'/∂y = ∂y'/∂x, and ∂y'/∂y."""
        r2 = x * x + y * y
        radial = 1 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        growth = 2 * (self.k1 + r2 * (2 * self.k2 + r2 * 3 * self.k3))
        return (radial + growth * x * x + 2 * self.p1 * y + 6 * self.p2 * x,
                growth * x * y + 2 * self.p1 * x + 2 * self.p2 * y,
                radial + growth * y * y + 6 * self.p1 * y + 2 * self.p2 * x)
