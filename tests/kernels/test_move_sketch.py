"""`move_sketches` and `seen_ranges` against their equations, pixel by pixel."""

import numpy as np
import pytest

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.kernels import cpu
from srt3d_ros.kernels.cpu.sketching.move_sketch import LOOKS
from srt3d_ros.kernels.lens import distorted

M, METRES_PER_BIN, STEEPEST = 5, 0.02, 0.1
LENSES = {"pinhole": Pinhole(40, 42, 10, 6),
          "distorted": Pinhole(40, 42, 10, 6, PlumbBob(-0.1, 0.02, 1e-3, -2e-3, 3e-3)),
          "scan": AngularScan(0.3, -0.02, 0.2, -0.02), "full turn": AngularScan(0.3, -2 * np.pi / 21, 0.2, -0.02),
          "line": AngularScan(0.3, -0.02, 0.2, -0.5)}


def arguments(lens, seed: int, shape=(13, 21)) -> dict:
    """Photons of a slanted surface with an edge, after a motion; some pixels have none, and some are masked."""
    rng, (rows, cols) = np.random.default_rng(seed), shape
    y, x = np.mgrid[:rows, :cols]
    rotation, offset = Pose.turned(rng.normal(scale=0.03, size=3)).rotation, rng.normal(scale=0.05, size=3)
    sums = rng.normal(size=(rows, cols, M, 2)).astype(np.float32).view(np.complex64)[..., 0]
    return {"sums": sums, "photons": rng.poisson(2, shape).astype(np.float32),
            "used": rng.random(shape) > 0.1, "rays": lens.rays(rows, cols),
            "ranges": (2 + 0.02 * x + 0.03 * y + (x > cols // 2)).astype(np.float32),
            "rotation": rotation.astype(np.float32), "offset": offset.astype(np.float32), "lens": lens.lens,
            "bin_frequencies": np.array([1, 2, 5, 30, 100], np.float32) / 500,
            "late": rng.normal(size=shape).astype(np.float32), "metres_per_bin": METRES_PER_BIN, "steepest": STEEPEST}


def move(given: dict, times: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """What the kernel makes of so many equal parts."""
    scene = cpu.SeenScene(*(given[name] for name in cpu.SeenScene._fields))
    motion = cpu.Motion(given["rotation"], given["offset"])
    return cpu.move_sketches([(motion, given["sums"], given["photons"])] * times, scene, given["lens"])


def seen_at(xyz: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """Row and column of a point in front of the sensor."""
    x, y, z = xyz
    if len(lens) > 4:
        x, y = distorted(x / z, y / z, *lens[4:9])
        return np.array([lens[1] * y + lens[3], lens[0] * x + lens[2]])
    turn, col = 2 * np.pi / abs(lens[1]), (np.arctan2(y, x) - lens[0]) / lens[1]
    return np.array([(np.arctan2(z, np.hypot(x, y)) - lens[2]) / lens[3], (col + 0.5) % turn - 0.5])


def by_equations(given: dict) -> tuple[np.ndarray, np.ndarray]:
    """The equations of the kernel's module, in double precision."""
    sums, photons, used, rays, ranges, rotation, offset, lens, bin_frequencies, late, metres_per_bin, steepest = (
        value.astype(np.result_type(value, float)) if isinstance(value, np.ndarray) else value
        for value in given.values())
    moved, numbers = np.zeros(sums.shape, complex), np.zeros(photons.shape)
    turns = 2j * np.pi * bin_frequencies

    def inside(row, col):
        return 0 <= row < photons.shape[0] and 0 <= col < photons.shape[1]

    for at in zip(*np.nonzero(used * photons)):
        place, length = at, ranges[at]
        for look in range(LOOKS + 1):
            xyz = rotation @ rays[at] * length + offset
            place = seen_at(xyz, lens)
            nearest = tuple(np.floor(place + 0.5).astype(int))
            if not inside(*nearest):
                break
            if look < LOOKS:
                length = np.linalg.norm(rays[nearest] * ranges[nearest] - offset)
        if not inside(*nearest):
            continue
        shares = []
        for corner in np.ndindex(2, 2):
            pixel = tuple(np.floor(place).astype(int) + corner)
            if not inside(*pixel) or abs(ranges[pixel] - ranges[nearest]) > steepest * ranges[nearest]:
                pixel = nearest
            shares.append((pixel, np.prod(1 - abs(np.floor(place) + corner - place))))
        xyz /= np.linalg.norm(xyz) * sum(share / ranges[pixel] for pixel, share in shares)
        depth = np.linalg.norm(xyz - offset) / metres_per_bin + late[at]
        for pixel, share in shares:
            own = ranges[pixel] / metres_per_bin + late[pixel]
            moved[pixel] += share * np.exp(turns * (own - depth)) * sums[at]
            numbers[pixel] += share * photons[at]
    return moved, numbers


@pytest.mark.parametrize(("lens", "seed", "shape"), [
    *((lens, seed, (13, 21)) for lens in list(LENSES)[:-1] for seed in (0, 1)), ("line", 3, (1, 40))])
def test_move_sketches(lens, seed, shape):
    given = arguments(LENSES[lens], seed, shape)
    expected, (moved, numbers) = by_equations(given), move(given, times=2)
    assert expected[1].sum() > 0.5 * given["photons"].sum()
    np.testing.assert_allclose(numbers, 2 * expected[1], atol=1e-3)
    np.testing.assert_allclose(moved, 2 * expected[0], atol=5e-3)   # of depths of 150 bins, whose steps are 1.5e-5


@pytest.mark.parametrize("motion", [Pose.turned([0, np.pi, 0]), Pose(translation=np.array([0, 0, -50.0])),
                                    Pose(np.full((3, 3), np.nan))])
def test_what_is_behind_the_camera_or_nowhere_is_left_out(motion):
    given = arguments(LENSES["pinhole"], 0)
    given["rotation"][:], given["offset"][:] = motion.rotation, motion.translation
    moved, numbers = move(given)
    assert not moved.any() and not numbers.any()


@pytest.mark.parametrize("lens", [LENSES["pinhole"], LENSES["distorted"], LENSES["scan"]], ids=lambda lens: lens.kind)
def test_each_pixel_sees_the_nearest_point_and_holes_lie_between_their_neighbours(lens):
    rng, shape = np.random.default_rng(0), (13, 21)
    rays = lens.rays(*shape).reshape(-1, 3)
    xyz = (rays[rng.integers(0, len(rays), 60)] * rng.uniform(1, 3, (60, 1)) + rng.normal(scale=0.02, size=(60, 3)))
    xyz[:3] = -xyz[:3]                  # behind a camera
    expected = np.full(shape, np.inf)
    for point in xyz[3:] if len(lens.lens) > 4 else xyz:
        row, col = seen_at(point, lens.lens)
        above, left = int(np.floor(row)), int(np.floor(col))
        for i, j in ((above, left), (above, left + 1), (above + 1, left), (above + 1, left + 1)):
            if 0 <= i < shape[0] and 0 <= j < shape[1]:
                expected[i, j] = min(expected[i, j], np.linalg.norm(point))
    pose = Pose(Pose.turned([0.3, -0.2, 1.0]).rotation, np.array([0.5, -0.3, 0.2]))
    motion = cpu.Motion(pose.rotation.astype(np.float32), pose.translation.astype(np.float32))
    before = pose.inverse()(xyz).astype(np.float32)
    found, known = cpu.seen_ranges(before, motion, lens.lens, shape), np.isfinite(expected)
    assert 30 < known.sum() < known.size - 30
    np.testing.assert_allclose(found[known], expected[known], rtol=1e-5)
    assert (found >= expected.min() - 1e-5).all() and (found <= expected[known].max() + 1e-5).all()


def test_without_points_nothing_is_seen():
    at_rest = cpu.Motion(np.eye(3, dtype=np.float32), np.zeros(3, np.float32))
    assert np.isinf(cpu.seen_ranges(np.empty((0, 3), np.float32), at_rest, LENSES["pinhole"].lens, (3, 4))).all()
