"""Reconstructor: clouds of the frames of one sensor by any method, on a GPU or, if that fails, on the CPU."""

import logging
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Unpack

import numpy as np

from srt3d_ros.cloud import Cloud, as_noun
from srt3d_ros.core.cover_glass import hidden_scene
from srt3d_ros.core.keys import written_out
from srt3d_ros.core.method.pile_up import contradiction
from srt3d_ros.core.methods import DEFAULT_METHOD, ReconstructorOptions, find
from srt3d_ros.core.motion.trajectory import Trajectory
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.photon_frame import PhotonFrame
from srt3d_ros.core.sketching.sums import PhaseSums, as_array
from srt3d_ros.errors import require
from srt3d_ros.gpu_check import device_for
from srt3d_ros.progress import compiling

ASKED = 10                  # of so many frames one is asked what contradicts the IRF: of all, 8 % of their time
LOOKED_AT = (1, 2, 3)       # frequencies, to see through a cover glass
NO_PHOTONS = "the frame has no photons, so its cloud has no points"


class Reconstructor:
    """Reconstructs frames of one sensor, one after the other; `pooled` keeps a memory of them and of the background.

    Args:
        sensor: of the sketches, behind the gate if there is one.
        frequencies: the integers k_l of the sketches; methods on photons need none.
        method, surfaces, device, false_alarm_rate, background, window_frames: see `__init__`.

    Attributes:
        device: "cpu" or "cuda", where it computes.
        device_reason: why there, for people to read.

    Raises:
        InvalidInput: naming the argument that cannot be used.
    """

    @written_out(ReconstructorOptions)
    def __init__(self, sensor: SensorModel, frequencies: Sequence[int] = (), **options: Unpack[ReconstructorOptions]):
        """Prepare for the frames of a sensor."""
        require(isinstance(sensor, SensorModel), "sensor", type(sensor).__name__, "a Sensor")
        given: dict[str, Any] = {"method": DEFAULT_METHOD, "surfaces": 1, "device": "auto", **options}
        method, device = given["method"], given["device"]
        self._frequencies = tuple(as_array("frequencies", frequencies, 1, "iuf").tolist())
        chosen = find(method)
        self._on_photons = chosen.needs == "photons"
        require(bool(self._frequencies) or self._on_photons, "frequencies",
                problem=f"{method} reads sketches: give their frequencies, sketch.frequencies.")
        self._name, self._surfaces, self._is_warm = given.pop("method"), given["surfaces"], False
        self._until_asked, self._last_doubts = 0, ()
        self._build = partial(chosen.build, sensor, self._frequencies, **given)
        if "device" not in chosen.options:
            self.device, self.device_reason = "cpu", f"{method} runs on the CPU"
            self._method = self._build()
            return
        self.device, self.device_reason = device_for(
            device, sensor, self._frequencies, lambda name: self._build(device=name))
        try:
            self._method = self._build(device=self.device)
        except RuntimeError as error:
            self._fall_back(error)

    def __call__(self, seen: Any, trajectory: Trajectory | None = None) -> Cloud:
        """The cloud of a frame: of its Sketch, or of its Photons or PhotonFrame for a method on photons.

        `trajectory` is that of a sensor that moves, with `window_frames` above 1. A window begins again where it does
        not reach from the last frame's stamp to this one's.
        """
        moving = () if trajectory is None else (trajectory,)
        require(not moving or self._build.keywords.get("window_frames", 1) > 1, "trajectory",
                problem="Only windows follow a trajectory: give window_frames above 1.")
        frame = getattr(seen, "events", seen) if self._on_photons else seen
        require(not self._on_photons or isinstance(frame, PhotonFrame), "seen", type(seen).__name__,
                "Photons, or their frame")       # `Matcher.check` asks for a Sketch
        self.warm_up()
        started = time.perf_counter()
        points = self._or_on_the_cpu(lambda: self._method(frame, *moving))
        elapsed_ms = round((time.perf_counter() - started) * 1e3, 3)
        photons, notes = int(np.sum(seen.photons)), getattr(seen, "notes", ())
        if isinstance(seen, PhaseSums) and self._name == DEFAULT_METHOD and (problem := contradiction(seen)):
            notes += (problem,)
        notes += self._doubts(seen, frame, points)
        if not photons and not len(points):
            notes += (NO_PHOTONS,)
        return as_noun(
            Cloud, points, notes=notes, method=self._name, surfaces=self._surfaces, device=self.device, photons=photons,
            reconstruct_ms=elapsed_ms, frequencies=() if self._on_photons else seen.frequencies)

    def _doubts(self, seen: Any, frame: Any, points: PointCloud) -> tuple[str, ...]:
        """What a cloud says against the IRF, or for a cover glass; the answer stands for ASKED frames."""
        if self._until_asked == 0:
            share, hidden = getattr(self._method, "misplaced_share", 0), ""
            if self._surfaces == 1 and len(points):
                most = max((points.sensor.num_bins - 1) // 2, 1)
                sketch = seen if isinstance(seen, PhaseSums) else sketch_photons(frame, points.sensor, LOOKED_AT[:most])
                hidden = hidden_scene(sketch, points)
            tail = "; if it is a wall, the IRF lacks its tail" * (share > 0)
            unexplained = (f"{share:.0%} of the photons near surfaces stay unexplained: the IRF lacks a tail, or there "
                           "is fog or a further surface")
            self._last_doubts = (hidden + tail,) if hidden else (unexplained,) if share else ()
        self._until_asked = (self._until_asked or ASKED) - 1
        return self._last_doubts

    def __reduce__(self):
        """For pickle and copy: made again from its arguments, without its memory; it chooses its device anew."""
        return partial(type(self), method=self._name, **self._build.keywords), self._build.args

    @property
    def uneven_background(self) -> float:
        """How uneven the background of the next frame is taken to be (pooled); 0 if flat."""
        return getattr(self._method, "uneven_background", 0.0)

    def forget(self) -> None:
        """Begin the next frame as if it were the first."""
        self._until_asked = 0
        if hasattr(self._method, "forget"):
            self._method.forget()

    def warm_up(self) -> None:
        """Compile what is not compiled yet, so that it does not count as time of a frame."""
        if not self._is_warm:
            with compiling():
                self._or_on_the_cpu(lambda: self._method.warm_up())
            self._is_warm = True

    def _or_on_the_cpu(self, task: Callable):
        """What a task returns; if a GPU fails in it, the CPU does it, and all that follows."""
        try:
            return task()
        except RuntimeError as error:           # torch's: no memory, a kernel that failed, or does not compile
            if self.device != "cuda":
                raise
            self._fall_back(error)
            self._method.warm_up()
            return task()

    def _fall_back(self, error: RuntimeError) -> None:
        self.device, self.device_reason = "cpu", f"the GPU failed: {str(error).partition(chr(10))[0]}"
        logging.getLogger(__name__).warning(f"{self.device_reason}: computing on the CPU from now on")
        self._method = self._build(device="cpu")
