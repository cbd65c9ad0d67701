"""What SRT3D and SMLE share: everything but how depths and intensities are found."""

import numpy as np

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.device import kernels_for
from srt3d_ros.core.matched_frame import MatchedFrame, Matcher
from srt3d_ros.core.pooled import check_options
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch, check_frequencies
from srt3d_ros.core.weighting import weighted_steps


class SketchedBaseline:
    """Reconstructs frames of one sensor from their sketches, by the points of a subclass.

    Args:
        sensor, frequencies, surfaces, device: as of `Pooled`.
        weighting: W of the data term, "identity" or "precision".
        false_alarm_rate: probability that a pixel that sees only background shows a point; None: no such test.
    """

    def __init__(self, sensor: SensorModel, frequencies, surfaces: int, weighting: str,
                 false_alarm_rate: float | None, device: str):
        check_options(surfaces, false_alarm_rate)
        self.device, self.kernels = kernels_for(device)
        self.sensor, self.surfaces, self.false_alarm_rate = sensor, surfaces, false_alarm_rate
        self._matcher = Matcher(sensor, check_frequencies(frequencies, sensor.num_bins))
        self.steps = weighted_steps(sensor, self._matcher.frequencies, weighting)
        self._table = self.kernels.array(self.steps.table)

    def __call__(self, sketch: Sketch) -> PointCloud:
        """The point cloud of one frame's sketch."""
        sketch = sketch.on_host()
        frame = self._matcher(sketch)
        depth, intensity = self.points(frame)
        signal = intensity * frame.exposure[:, None]
        std = self.steps.depth_std(signal, frame.counts[:, None])
        background = np.maximum(sketch.photons - signal.sum(axis=1), 0)
        return PointCloud.from_layers(self.sensor, depth, intensity, std, background, sketch.stamp_ns)

    def points(self, frame: MatchedFrame) -> tuple[np.ndarray, np.ndarray]:
        """Depth (bins) and intensity of the surfaces, float32 [rows, K, cols]; intensity 0 = no point."""
        raise NotImplementedError

    def step(self, frame: MatchedFrame, rate: float, usual: float, depth, intensity) -> None:
        """A gradient step of all points in place; frame and points lie on the device."""
        self.kernels.pixelwise(frame, self._table, rate, usual, depth, intensity)

    def warm_up(self) -> None:
        """Compile the kernels, or load them from the disk."""
        shape, m = (self.sensor.rows, self.sensor.cols), len(self._matcher.frequencies)
        self(Sketch(self._matcher.frequencies, np.zeros((*shape, m), np.complex64), np.zeros(shape, np.uint32)))


def matched_filter(frame: MatchedFrame, surfaces: int, kernels) -> tuple[np.ndarray, np.ndarray]:
    """The start: depth and intensity of each pixel's strongest returns, float32 [rows, K, cols]; 0 where none.

    The frame lies on the kernels' device, the start does not.
    """
    found = kernels.match(frame, surfaces)
    depth, intensity, exposure = (kernels.numpy(values) for values in (*found, frame.exposure[:, None]))
    return depth, np.where(exposure > 0, np.maximum(intensity, 0) / np.maximum(exposure, 1e-6), 0).astype(np.float32)
