"""LightMeter: how many photons a frame has, how many of them are signal, and up to where the IRF is right.

Two signal photons of a pixel lie apart as two draws of the IRF do, at whatever depth; a background photon lies anywhere.
So cos ω(x − x') is p²·|ĥ(ω)|² in the mean over the pairs of photons of a pixel, with p the share of the signal, and
|Σ_x exp(i ω x)|² = n + 2 Σ_pairs cos ω(x − x') is a sketch's. No depth has to be known, and the scene may spread over all
bins. A pulse that is not the IRF's, fog, and pixels that see two surfaces show as other values than |ĥ|².
"""

import numpy as np

from srt3d_ros.core.frequency_design import highest_passed, increasing, typical_spectrum
from srt3d_ros.core.light import Light
from srt3d_ros.core.photons import PhotonEvents, PhotonFrame, PhotonGates
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketching import Sketcher

RUNGS = 40              # frequencies that are looked at, in a geometric progression
MOST_PIXELS = 2**14     # that are looked at, evenly spread: 10 MB, and 5 ms for 10 photons in each
WELL_PASSED = 0.5       # |ĥ|² of the frequencies that tell the share of the signal
# By which |ĥ|² may differ from what the photons say, relative, with its standard error. In the third-party Art frames
# and the head's up to the highest frequency of use it does not; the mannequin's IRF is wrong by this from |ĥ| = 0.45 on.
DOUBT = 0.08
NEIGHBOURS = 3          # rungs that are judged together
SEEN = 3.0              # standard errors from which on there is signal


class LightMeter:
    """Adds up the photons of a frame, in any split, and tells their light.

    Args:
        sensor: pixels, T, IRF, mask and gate words.
    """

    def __init__(self, sensor: SensorModel):
        self.sensor = sensor
        self._step = -(-sensor.pixels // MOST_PIXELS)
        used = np.ones(sensor.pixels, bool) if sensor.mask is None else sensor.mask.ravel()
        self._used = used[::self._step]
        self._spectrum = np.abs(typical_spectrum(sensor))**2
        top = highest_passed(sensor)
        self._rungs = increasing(np.geomspace(1, top, min(RUNGS, top)))
        seen = SensorModel(1, len(self._used), sensor.num_bins, sensor.bin_width_s, np.ones(1), gates=sensor.gates)
        self._sketcher = Sketcher(seen, self._rungs)

    def add(self, frame: PhotonFrame) -> None:
        """Add the photons of a frame or packet; InvalidInput if one is outside the sensor."""
        self._sketcher.add(_every(self._step, frame, self.sensor))

    def light(self) -> Light:
        """The light of all photons since the last call."""
        sketch = self._sketcher.sketch()
        self._sketcher.reset()
        photons = sketch.photons[0, self._used].astype(np.float64)
        mean, several = float(photons.mean()) if len(photons) else 0.0, photons > 1
        n = photons[several]
        if not len(n):
            return Light(mean, 0.0, 0)
        # Each photon's mean over the others of its pixel: so one bright pixel weighs as its photons, not as their square.
        sums = sketch.sums[0, self._used][several].astype(np.complex128)
        alike = ((np.abs(sums)**2 - n[:, None]) / (n[:, None] - 1)).sum(axis=0) / n.sum()
        error = np.sqrt((n / (n - 1)).sum()) / n.sum()          # of each, by background alone
        expected = self._spectrum[list(self._rungs)]
        told = expected >= min(WELL_PASSED, expected[0])
        share2 = (expected[told] @ alike[told]) / (expected[told] @ expected[told])
        if share2 < SEEN * error / np.sqrt(told.sum()):
            return Light(mean, 0.0, 0)
        return Light(mean, float(min(np.sqrt(share2), 1.0)), self._confirmed(alike / share2, expected, error / share2))

    def _confirmed(self, seen: np.ndarray, expected: np.ndarray, error: float) -> int:
        """The last rung before the first where |ĥ|² is not as `expected`, or cannot be told."""
        wrong = np.abs(_smooth(seen - expected)) + error / np.sqrt(NEIGHBOURS) > DOUBT * _smooth(expected)
        rungs = len(wrong) if not wrong.any() else int(wrong.argmax())
        return self._rungs[rungs - 1] if rungs else 0


def light_of(frame: PhotonFrame, sensor: SensorModel) -> Light:
    """The light of one frame."""
    meter = LightMeter(sensor)
    meter.add(frame)
    return meter.light()


def _every(step: int, frame: PhotonFrame, sensor: SensorModel) -> PhotonFrame:
    """The photons of every `step`-th pixel, as of a sensor with those in one row."""
    if isinstance(frame, PhotonGates):
        frame.check(sensor)
        words = frame.words.reshape(len(frame.words), 1, sensor.pixels)[:, :, ::step]
        return PhotonGates(np.ascontiguousarray(words), frame.stamp_ns)
    if step == 1:
        return frame
    kept = frame.pixel % step == 0
    return PhotonEvents(frame.pixel[kept] // np.uint32(step), frame.toa[kept], frame.stamp_ns)


def _smooth(values: np.ndarray) -> np.ndarray:
    """Mean over NEIGHBOURS rungs, over those that there are at the ends."""
    ones = np.ones(NEIGHBOURS)
    return np.convolve(values, ones, "same")[:len(values)] / np.convolve(np.ones(len(values)), ones, "same")[:len(values)]
