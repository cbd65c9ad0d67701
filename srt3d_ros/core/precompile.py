"""Runs the CPU kernels of the default method on few data: they are compiled, or read from the disk."""

import numpy as np

from srt3d_ros.core.method.memory import PooledStream
from srt3d_ros.core.motion.moving_sketcher import MovingSketcher
from srt3d_ros.core.motion.trajectory import Pose, Trajectory
from srt3d_ros.core.sensor.model import MAX_BINS, GateWords, SensorModel
from srt3d_ros.core.sketching.frequencies import choose
from srt3d_ros.core.sketching.photons import PhotonEvents, PhotonGates
from srt3d_ros.core.sketching.sketcher import Sketcher

ANY_SENSOR = SensorModel(rows=1, cols=2, num_bins=MAX_BINS, bin_width_s=1e-9, irf=[1.0], gates=GateWords())


def sketching() -> None:
    """Sketch photons in whole bins, in order and not, and gates."""
    sketcher = Sketcher(ANY_SENSOR, (1,))
    sketcher.add(PhotonGates(np.zeros((1, 1, 2), np.uint16)))
    for pixels in ([0, 1], [1, 0]):
        sketcher.add(PhotonEvents(np.array(pixels, np.uint32), np.zeros(2, np.uint16)))
    sketcher.sketch()


def deskewing() -> None:
    """Move a frame of a sensor that moves."""
    sketcher, trajectory = MovingSketcher(ANY_SENSOR, (1,)), Trajectory()
    trajectory.add(0, Pose())
    sketcher.add(PhotonEvents(np.array([0, 1], np.uint32), np.zeros(2, np.uint16)))
    sketcher.finish(sketcher.end_frame(), trajectory)


def reconstruction() -> None:
    """A frame by the default method, of two surfaces: they take one kernel more than one does."""
    PooledStream(ANY_SENSOR, choose("auto", ANY_SENSOR, 3), surfaces=2, device="cpu").warm_up()
