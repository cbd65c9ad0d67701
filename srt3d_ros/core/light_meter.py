"""LightMeter: how many photons a frame has, how many of them are signal, and up to where the IRF is right.

Two signal photons of a pixel lie apart as two draws of the IRF do, at whatever depth, and a background photon lies
anywhere. So over the pairs of photons of a pixel the mean of cos ω(x − x') is p²·|ĥ(ω)|², where p is the share of the
signal. A sketch has the sum over pairs: |Σ_x exp(i ω x)|² = n + 2 Σ cos ω(x − x'). No depth has to be known, and the
scene may spread over all bins. Pulses that are not the IRF's, fog, and pixels with two surfaces show as other values
than |ĥ|².
"""

from dataclasses import replace

import numpy as np

from srt3d_ros.core.frame_watch import FrameLooks
from srt3d_ros.core.frequency_design import Light, highest_passed, increasing, typical_spectrum
from srt3d_ros.core.photons import PhotonFrame, PhotonGates, PhotonHistograms
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketching import Sketcher

LOOK_NS = 2_000_000_000     # between two frames that are looked at: frequencies change no more often
RUNGS = 40              # frequencies that are looked at, in a geometric progression
MOST_PIXELS = 2**15     # that are looked at, evenly spread: 21 MB, 10 ms
MOST_PHOTONS = 2**21    # of them, about: 30 ms
WELL_PASSED = 0.5       # |ĥ|² of the frequencies that tell the share of the signal
# By which |ĥ|² may differ from what the photons say, relative, with its standard error. Those of Art and the head agree
# up to |ĥ| = 0.2, those of the mannequin, whose IRF is too smooth, up to 0.43: above, higher k add up to 20 % of DAE.
DOUBT = 0.08
NEIGHBOURS = 3          # rungs that are judged together
SEEN = 3.0              # standard errors from which on there is signal


class LightMeter(FrameLooks):
    """Measures the Light of the frames that it looks at."""

    def __init__(self, sensor: SensorModel):
        super().__init__(sensor, LOOK_NS)
        self._mask = np.ones(sensor.pixels, bool) if sensor.mask is None else sensor.mask.ravel()
        top = highest_passed(sensor)
        self._rungs = increasing(np.geomspace(1, top, min(RUNGS, top)))
        self._expected = np.abs(typical_spectrum(sensor)[list(self._rungs)])**2
        # Depths lie between bins, which may widen a pulse by a bin.
        self._wider = self._expected * np.sinc(np.array(self._rungs) / sensor.num_bins)**2
        self._sketcher: Sketcher | None = None  # of the pixels of the last look, in a row

    def _begin(self, most: int) -> None:
        sensor = self._sensor
        self._step = _power_of_two(max(sensor.pixels / MOST_PIXELS, most / MOST_PHOTONS))    # from pixel to pixel
        pixels = -(-sensor.pixels // self._step)
        if self._sketcher is None or self._sketcher.sensor.pixels != pixels:
            row = SensorModel(1, pixels, sensor.num_bins, sensor.bin_width_s, np.ones(1), gates=sensor.gates)
            self._sketcher = Sketcher(row, self._rungs)
        self._sketcher.reset()

    def _look(self, frame: PhotonFrame) -> None:
        self._sketcher.add(self._in_a_row(frame))

    def _end(self) -> Light:
        return self._light(self._sketcher.sketch())

    def _in_a_row(self, frame: PhotonFrame) -> PhotonFrame:
        """The photons of every step-th pixel, as of the sketcher's sensor."""
        step = self._step
        if isinstance(frame, PhotonGates):
            frame.check(self._sensor)
            words = frame.words.reshape(len(frame.words), 1, -1)[:, :, ::step]
            return PhotonGates(np.ascontiguousarray(words), frame.stamp_ns)
        if isinstance(frame, PhotonHistograms):
            frame.check(self._sensor)
            counts = frame.on_axis(self._sensor).reshape(1, self._sensor.pixels, -1)
            return PhotonHistograms(counts[:, ::step], frame.stamp_ns)
        if step == 1:
            return frame
        kept = frame.part(np.flatnonzero(frame.pixel & np.uint32(step - 1) == 0))
        return replace(kept, pixel=kept.pixel // np.uint32(step))

    def _light(self, sketch: Sketch) -> Light:
        used = self._mask[::self._step]
        photons, several = sketch.photons[0].astype(np.float64), used & (sketch.photons[0] > 1)
        seen, n = int(photons[used].sum()), photons[several]
        self._photons, mean = seen * self._step, seen / max(np.count_nonzero(used), 1)
        if not len(n):
            return Light(mean, 0.0, 0)
        # Of each photon the mean over the others of its pixel: a bright pixel weighs as its photons, not as its pairs.
        each = several / np.maximum(photons - 1, 1)
        total = each.astype(np.float32) @ np.square(sketch.sums[0].view(np.float32))
        alike = (total.reshape(-1, 2).sum(axis=1, dtype=np.float64) - each @ photons) / n.sum()
        error = np.sqrt((n / (n - 1)).sum()) / n.sum()          # of each, by background alone
        told = self._expected >= min(WELL_PASSED, self._expected[0])
        known = self._expected[told]
        share2 = known @ alike[told] / (known @ known)
        if share2 < SEEN * error / np.sqrt(len(known)):
            return Light(mean, 0.0, 0)
        return Light(mean, float(min(np.sqrt(share2), 1.0)), self._confirmed(alike / share2, error / share2))

    def _confirmed(self, seen: np.ndarray, error: float) -> int:
        """The last rung before the first where |ĥ|² is not as `seen`, or cannot be told."""
        off = np.maximum(_smooth(seen - self._expected), _smooth(self._wider - seen)) + error / np.sqrt(NEIGHBOURS)
        wrong = off > DOUBT * _smooth(self._expected)
        rungs = int(wrong.argmax()) if wrong.any() else len(wrong)
        return self._rungs[rungs - 1] if rungs else 0


def _power_of_two(least: float) -> int:
    """The smallest that is `least` or more, 1 at least."""
    return 1 << max(int(np.ceil(np.log2(max(least, 1)))), 0)


def _smooth(values: np.ndarray) -> np.ndarray:
    """Mean over NEIGHBOURS rungs; beyond the ends they are as the last one."""
    padded = np.pad(values, NEIGHBOURS // 2, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, NEIGHBOURS).mean(axis=1)
