"""`pooled`: spatially regularised 3D reconstruction from sketches alone, with the data term of SRT3D.

    J. Tachella, M. P. Sheehan, M. E. Davies, "Sketched RT3D: how to reconstruct billions of photons per second",
    ICASSP 2022.

It minimises Σ_ij n_ij ‖z_ij − Ψ_θij‖² + ρ(θ), with Ψ_θ(ω) = Σ_k α_k ĥ(ω) exp(i ω t_k), by alternating gradient steps on
depth t and intensity r = n α, a threshold on the evidence for each point, and a denoiser of the point cloud that also
creates and removes points. The paper's denoiser, APSS, smooths depths afterwards (`baselines.srt3d`). Here the denoiser
is the data term itself, and photons are shared instead: the sketches of the pixels around a point add up along the
point's tangent plane (moving least squares, the planar case of the paper's algebraic point set surfaces), each weighted
by how surely it sees the same surface. Where photons are plenty the depths are known so well that the weights end at
the finest relief; where they are few a point borrows from the whole window.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from srt3d_ros.core import layout
from srt3d_ros.core.background import Background
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.device import kernels_for
from srt3d_ros.core.frame import Frame, Matcher
from srt3d_ros.core.precision import Precision
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch, check_frequencies
from srt3d_ros.core.start import (
    REST_SCALES,
    SURE,
    SURE_SCALES,
    continuation_threshold,
    find_surfaces,
    score_threshold,
)
from srt3d_ros.core.upsampling import refine
from srt3d_ros.core.weighting import WEIGHTINGS
from srt3d_ros.errors import require

DEFAULT_FALSE_ALARM_RATE = 1e-4
MAX_SURFACES = 4
WARM_FRAMES = 4                     # after which a GPU has recorded what it does: each of two frames on their way twice
WINDOWS = ((2.0, 3), (3.0, 5), (4.5, 6))    # σ and radius of the pooling window in each iteration, pixels
RELIEF = (5.0, 6)                   # σ and radius of the neighbourhood whose relief counts as uncertainty, pixels
SPREAD = 4                          # pixels by which surfaces may grow in each
WEAK = 5.0                          # standard deviations under which a point is searched for anew
SAME_SURFACE = 4.8                  # depths within this many standard deviations may belong to one surface


class Pooled:
    """Reconstructs frames of one sensor, one after the other: its memory stays from frame to frame.

    Args:
        sensor: geometry, IRF and calibration.
        frequencies: the integers k_l of the sketches.
        surfaces: K, the most surfaces in a pixel, 1 … 4.
        false_alarm_rate: probability that a pixel that sees only background shows a point, before its neighbours have
            a say.
        device: "cpu", "cuda", or "auto" for the best there is.
        background: how it spreads over the bins: as the "sensor" says, "flat", or an "estimate" from each frame.
        weighting: W of the data term in the last iteration, "identity" or "precision": with the inverse covariance of
            the sketch depths are a few percent better where signal is plenty and the IRF exact, and worse where it is
            not.
        warm_start: begin with the last frame's surfaces where this one's photons still speak for them, and search for
            the others: less depth error while the scene goes on, a little more time where photons are few. For frames
            that follow each other.
        upsampling: u, 1 … 4: the cloud has u × u finer pixels in the place of each, see `upsampling.refine`; they are
            those of `self.sensor`, and intensity and background are photons of one of them.

    Raises:
        InvalidInput: for a parameter that cannot be used.
    """

    def __init__(self, sensor: SensorModel, frequencies, surfaces: int = 1,
                 false_alarm_rate: float = DEFAULT_FALSE_ALARM_RATE, device: str = "auto",
                 background: str = "sensor", weighting: str = "identity", warm_start: bool = False,
                 upsampling: int = 1):
        check_options(surfaces, false_alarm_rate)
        self.device, self.kernels = kernels_for(device)
        self.sensor, self.upsampling = sensor.upsampled(upsampling), upsampling
        self.surfaces = surfaces
        self.false_alarm_rate = false_alarm_rate
        self._matcher = Matcher(sensor, check_frequencies(frequencies, sensor.num_bins))
        self._background = Background(self._matcher, background)
        require(weighting in WEIGHTINGS, "weighting", weighting, " or ".join(WEIGHTINGS))
        self._precision = Precision(sensor, self._matcher.frequencies) if weighting == "precision" else None
        array = self.kernels.array
        self._padded = self._matcher.padded_on(self.kernels, self._background.clutter)
        self._equaliser, self._used, self._rays = map(array, (self._matcher.equaliser, self._matcher.used, sensor.rays))
        self._scratch = self.kernels.Scratch()
        # The precision weighting looks at the frame before it goes on, so it cannot be recorded and replayed.
        self._first, self._next = (self.kernels.Pipeline(partial(self._points, warm), replays=self._precision is None)
                                   for warm in (False, True))
        self._warm_start, self._warm = warm_start, False

    def forget(self) -> None:
        """Begin the next frame as if it were the first."""
        self._warm = False

    def __call__(self, sketch: Sketch) -> PointCloud:
        """The point cloud of one frame's sketch."""
        return self.submit(sketch)()

    def submit(self, sketch: Sketch) -> Callable[[], PointCloud]:
        """Begin a frame; what is returned waits for its cloud.

        On a GPU the next frame's sketch goes there, and the last one's cloud comes back, while a frame is computed: ask
        for a cloud after the next frame has been submitted. A sketch that is there already stays there. On a CPU the
        cloud is ready at once.
        """
        self._matcher.check(sketch)
        if self.device == "cpu":
            sketch = sketch.on_host()
        maps = (sketch.sums,)
        if not self._background.is_flat:
            frame = self._background.remove(self._matcher(sketch)).padded
            maps = frame.matched, frame.noise
        pipeline = self._next if self._warm else self._first
        wait = pipeline.submit(sketch.photons, *maps)
        self._warm = self._warm_start
        return lambda: self._cloud(sketch.stamp_ns, *wait())

    def _points(self, warm: bool, photons, *maps) -> tuple:
        """The points of a frame and its background, of photons and sums, or of photons and a Frame's maps."""
        kernels, scratch = self.kernels, self._scratch
        if len(maps) == 1:
            maps = kernels.prepare(*maps, photons, self._equaliser, self._used, scratch)
        frame = self._padded(*maps)
        threshold = score_threshold(self.false_alarm_rate, max(self._matcher.frequencies), REST_SCALES[-1])
        state = self._begin(frame, warm)
        state = find_surfaces(frame, state, REST_SCALES, threshold, kernels, scratch)
        for window in WINDOWS[1:-1]:
            state = self._iterate(frame, state, window)
        state = self._iterate(frame, state, WINDOWS[-1], self._precision)
        enough = continuation_threshold(self.false_alarm_rate)
        intensity, std, background = kernels.settle(frame, photons, state, enough, *RELIEF, SAME_SURFACE**2, scratch)
        sensor = self._matcher.sensor
        points = kernels.collect(state, intensity, std, self._rays, sensor.bin_width_m, float(sensor.range_m(0)),
                                 sensor.num_bins)
        return background, *points

    def _begin(self, frame: Frame, warm: bool):
        """Surfaces of which the photons leave no doubt; of the last frame's less evidence is enough."""
        scratch, carried = self._scratch, None
        state = scratch.array("state", layout.state_shape(*frame.shape, self.surfaces))
        if warm:
            carried = scratch.array("carried", state.shape)
            carried[:] = state
        state = scratch.array("state", state.shape, zero=True)
        state = find_surfaces(frame, state, SURE_SCALES, SURE, self.kernels, scratch, carried,
                              continuation_threshold(self.false_alarm_rate))
        state = self._iterate(frame, state, WINDOWS[0])
        self.kernels.drop_weak(state, WEAK)
        return state

    def _iterate(self, frame: Frame, state, window, precision: Precision | None = None):
        """Let surfaces compete and spread, then step down the gradient of the data pooled over the window."""
        sigma, radius = window
        proposed = self.kernels.propose(frame, state, sigma, SAME_SURFACE**2, SPREAD, self._scratch)
        if precision:
            frame = precision(frame, proposed, self.kernels)
        return self.kernels.descend(frame, proposed, radius, SAME_SURFACE**2, out=state)

    def warm_up(self) -> None:
        """Compile the kernels, or load them from the disk, so that the first frame is as fast as the others.

        On a GPU the memory of the frames is made too, and what is computed recorded: for frames of this size.
        """
        if self.device == "cuda":
            for _ in range(WARM_FRAMES + self._warm_start):
                self(noise(self._matcher.sensor, self._matcher.frequencies))
            self._warm = False
        else:
            small = SensorModel(8, 8, self.sensor.num_bins, self.sensor.bin_width_s, self.sensor.irf.reshape(
                -1, self.sensor.irf.shape[-1])[0], self.sensor.irf_ref)
            Pooled(small, self._matcher.frequencies, self.surfaces, device=self.device)(
                noise(small, self._matcher.frequencies))

    def _cloud(self, stamp_ns: int, background, row, col, rank, values, xyz) -> PointCloud:
        """The cloud of a frame's points."""
        depth, intensity, std, *slopes = values
        cloud = PointCloud(row, col, depth, intensity, std, xyz, rank, background, stamp_ns)
        return cloud if self.upsampling == 1 else refine(cloud, self.upsampling, self.sensor, *slopes)


def check_options(surfaces: int, false_alarm_rate: float) -> None:
    """Raise InvalidInput unless both can be used."""
    require(isinstance(surfaces, int) and 1 <= surfaces <= MAX_SURFACES, "surfaces", surfaces,
            f"an integer from 1 to {MAX_SURFACES}")
    require(0 < false_alarm_rate < 1, "false_alarm_rate", false_alarm_rate, "a probability between 0 and 1")


def noise(sensor: SensorModel, frequencies: tuple[int, ...]) -> Sketch:
    """A sketch that shows nothing."""
    rng = np.random.default_rng(0)
    sums = rng.normal(size=(sensor.rows, sensor.cols, len(frequencies), 2)).astype(np.float32)
    return Sketch(frequencies, sums.view(np.complex64)[..., 0], np.full((sensor.rows, sensor.cols), 9, np.uint32))
