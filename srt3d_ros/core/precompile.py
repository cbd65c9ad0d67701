"""Compiles the kernels of the CPU ahead of time: each function runs the code that needs some of them, on few data."""

from types import SimpleNamespace

import numpy as np

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.matched_frame import Matcher
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.motion import Pose, Trajectory
from srt3d_ros.core.moving_sketcher import MovingSketcher
from srt3d_ros.core.photons import TOA_DTYPES, PhotonEvents, PhotonGates
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import MAX_BINS, GateWords, SensorModel
from srt3d_ros.core.sketch import noise_sketch
from srt3d_ros.core.window import WindowSketcher
from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import SAME_SURFACE

ANY_SENSOR = SensorModel(rows=1, cols=2, num_bins=MAX_BINS, bin_width_s=1e-9, irf=[1.0], gates=GateWords())
FREQUENCIES = choose("auto", ANY_SENSOR, 3)


def sketching() -> None:
    """Sketch photons in every form in which they may arrive."""
    sketcher = WindowSketcher(ANY_SENSOR, (1,))
    sketcher.add(PhotonGates(np.zeros((1, 1, 2), np.uint16)))
    for toa_dtype in TOA_DTYPES:
        for pixels in ([0, 1], [1, 0]):         # sorted and not
            sketcher.add(PhotonEvents(np.array(pixels, np.uint32), np.zeros(2, toa_dtype)))
    sketcher.sketch()


def deskewing() -> None:
    """Move a window of two frames of a sensor that moves."""
    sketcher, trajectory, ranges = MovingSketcher(ANY_SENSOR, (1,), 2), Trajectory(), np.ones((1, 2), np.float32)
    for at_ns in (0, 100):
        trajectory.add(at_ns, Pose())
    for stamp_ns in (0, 10):
        sketcher.add(PhotonEvents(np.array([0, 1], np.uint32), np.zeros(2, TOA_DTYPES[0]), stamp_ns))
        sketcher.finish(sketcher.end_frame(), trajectory, ranges)


def birth_death() -> None:
    """A step of `birth_death` from no surfaces."""
    from srt3d_ros.kernels import cpu

    frame = Matcher(ANY_SENSOR, FREQUENCIES)(noise_sketch(ANY_SENSOR, FREQUENCIES)).padded
    state = maps.no_surfaces(*frame.shape, 1)
    terms = np.zeros((*state.shape[:2], maps.TERMS, state.shape[3]), np.float32)
    cpu.birth_death(frame, state, terms, SAME_SURFACE**2)


def all_but_birth_death() -> None:
    """A reconstruction by the default method, of up to two surfaces a pixel, in which none moves."""
    from srt3d_ros.kernels import cpu

    reconstructor = Pooled(ANY_SENSOR, FREQUENCIES, surfaces=2, device="cpu")
    reconstructor.kernels = SimpleNamespace(**vars(cpu) | {"birth_death": lambda frame, state, *_: state.copy()})
    reconstructor(noise_sketch(ANY_SENSOR, FREQUENCIES))


def smle() -> None:
    """A reconstruction by SMLE, which needs the kernels of SRT3D as published but for its denoiser."""
    METHODS["smle"].build(ANY_SENSOR, FREQUENCIES, device="cpu").warm_up()


def rt3d() -> None:
    """A reconstruction by RT3D, whose denoiser is that of SRT3D as published."""
    METHODS["rt3d"].build(ANY_SENSOR, device="cpu").warm_up()


BASELINES = smle, rt3d
# For two processes, which take as long: 24 s of a core each, of a busy AMD EPYC, and 7 s more for the baselines.
PARTS = (birth_death, sketching, smle), (all_but_birth_death, deskewing, rt3d)
