"""SRT3D as its paper runs it: pixelwise gradient steps on the sketches, in turn with an APSS denoiser.

    J. Tachella, M. P. Sheehan, M. E. Davies, "Sketched RT3D: how to reconstruct billions of photons per second",
    ICASSP 2022.

It minimises Σ_ij n_ij (z_ij − Ψ_θij)ᵀ W (z_ij − Ψ_θij) + ρ(θ): matched filter on each pixel's sketch, 5 gradient steps,
then 25 iterations of gradient step, hard threshold on intensity and APSS. Frequencies 1 … m and W = identity are the
paper's. Its step sizes are tuned for each data set; here they are half the inverse curvature of the data term in
intensity and a quarter of it in depth, there that at the mean intensity for weaker points, as if one step size held for
all pixels.
"""

from functools import partial

import numpy as np

from srt3d_ros.core.baselines.plug_and_play import FAINTEST, RATE, depth_scale_bins, plug_and_play, usual_intensity
from srt3d_ros.core.baselines.sketched import SketchedBaseline, matched_filter
from srt3d_ros.core.matched_frame import MatchedFrame
from srt3d_ros.core.sensor import SensorModel

STEPS_BEFORE = 5


class SRT3D(SketchedBaseline):
    """As in the paper, with weighting "identity"."""

    def __init__(self, sensor: SensorModel, frequencies, surfaces: int = 1, weighting: str = "identity",
                 device: str = "auto"):
        super().__init__(sensor, frequencies, surfaces, weighting, None, device)

    def points(self, frame: MatchedFrame) -> tuple[np.ndarray, np.ndarray]:
        """Depths and intensities, [rows, K, cols]."""
        kernels, there = self.kernels, frame.on(self.kernels)
        start = matched_filter(there, self.surfaces, kernels)
        usual = usual_intensity(start[1], frame.exposure)
        step = partial(self.step, there, RATE, usual)
        depth, intensity = (kernels.array(values) for values in start)
        for _ in range(STEPS_BEFORE):
            step(depth, intensity)
        scale = depth_scale_bins(self.sensor, kernels.numpy(depth), kernels.numpy(intensity), frame.resolution_bins)
        depth, intensity = plug_and_play(step, depth, intensity, there.exposure, FAINTEST * usual, scale,
                                         frame.num_bins, kernels)
        return kernels.numpy(depth), kernels.numpy(intensity)
