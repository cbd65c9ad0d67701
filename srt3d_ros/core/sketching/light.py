"""How many photons a frame has, how many of them are signal, and up to where the IRF is right.

Two signal photons of a pixel lie apart as two draws of the IRF do, at whatever depth, and a background photon lies
anywhere. So over the pairs of photons of a pixel the mean of cos ω(x − x') is p²·|ĥ(ω)|², where p is the share of the
signal. A sketch has the sum over pairs: |Σ_x exp(i ω x)|² = n + 2 Σ cos ω(x − x'). No depth has to be known, and the
scene may spread over all bins. Pulses that are not the IRF's, fog, and pixels with two surfaces show as other values
than |ĥ|².
"""

from dataclasses import replace

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequency_design import Light, highest_passed, increasing, typical_spectrum
from srt3d_ros.core.sketching.photons import PhotonFrame, PhotonGates, PhotonHistograms, most_photons
from srt3d_ros.core.sketching.sketcher import sketch_photons

RUNGS = 40              # frequencies that are looked at, in a geometric progression
MOST_PIXELS = 2**15     # that are looked at, evenly spread: 21 MB, 10 ms
MOST_PHOTONS = 2**21    # of them, about: 30 ms
WELL_PASSED = 0.5       # |ĥ|² of the frequencies that tell the share of the signal
# By which |ĥ|² may differ from what the photons say, relative, with its standard error. Those of Art and the head agree
# up to |ĥ| = 0.2, those of the mannequin, whose IRF is too smooth, up to 0.43: above, higher k add up to 20 % of DAE.
DOUBT = 0.08
NEIGHBOURS = 3          # rungs that are judged together
SEEN = 3.0              # standard errors from which on there is signal


def light_of(frame: PhotonFrame, sensor: SensorModel) -> Light:
    """The light of a frame, before any gate; InvalidInput for photons that are not the sensor's."""
    step = _power_of_two(max(sensor.pixels / MOST_PIXELS, most_photons(frame) / MOST_PHOTONS))  # from pixel to pixel
    row = SensorModel(1, -(-sensor.pixels // step), sensor.num_bins, sensor.bin_width_s, np.ones(1), gates=sensor.gates)
    top = highest_passed(sensor)
    rungs = increasing(np.geomspace(1, top, min(RUNGS, top)))
    sketch = sketch_photons(_in_a_row(frame, sensor, step), row, rungs)
    expected = np.abs(typical_spectrum(sensor)[list(rungs)])**2
    used = np.ones(row.pixels, bool) if sensor.mask is None else sensor.mask.ravel()[::step]
    photons, several = sketch.photons[0].astype(np.float64), used & (sketch.photons[0] > 1)
    n, mean = photons[several], int(photons[used].sum()) / max(np.count_nonzero(used), 1)
    if not len(n):
        return Light(mean, 0.0, 0)
    # Of each photon the mean over the others of its pixel: a bright pixel weighs as its photons, not as its pairs.
    each = several / np.maximum(photons - 1, 1)
    total = each.astype(np.float32) @ np.square(sketch.sums[0].view(np.float32))
    alike = (total.reshape(-1, 2).sum(axis=1, dtype=np.float64) - each @ photons) / n.sum()
    error = np.sqrt((n / (n - 1)).sum()) / n.sum()          # of each, by background alone
    told = expected >= min(WELL_PASSED, expected[0])
    known = expected[told]
    share2 = known @ alike[told] / (known @ known)
    if share2 < SEEN * error / np.sqrt(len(known)):
        return Light(mean, 0.0, 0)
    wider = expected * np.sinc(np.array(rungs) / sensor.num_bins)**2    # depths lie between bins: a bin wider
    confirmed = _confirmed(alike / share2, expected, wider, error / share2)
    return Light(mean, float(min(np.sqrt(share2), 1.0)), rungs[confirmed - 1] if confirmed else 0)


def _in_a_row(frame: PhotonFrame, sensor: SensorModel, step: int) -> PhotonFrame:
    """The photons of every step-th pixel, as of a sensor that has these in a row."""
    if isinstance(frame, PhotonGates):
        frame.check(sensor)
        words = frame.words.reshape(len(frame.words), 1, -1)[:, :, ::step]
        return PhotonGates(np.ascontiguousarray(words), frame.stamp_ns)
    if isinstance(frame, PhotonHistograms):
        frame.check(sensor)
        counts = frame.on_axis(sensor).reshape(1, sensor.pixels, -1)
        return PhotonHistograms(counts[:, ::step], frame.stamp_ns)
    if step == 1:
        return frame
    kept = frame.part(np.flatnonzero(frame.pixel & np.uint32(step - 1) == 0))
    return replace(kept, pixel=kept.pixel // np.uint32(step))


def _confirmed(seen: np.ndarray, expected: np.ndarray, wider: np.ndarray, error: float) -> int:
    """The number of rungs before the first where |ĥ|² is not as `seen`, or cannot be told."""
    off = np.maximum(_smooth(seen - expected), _smooth(wider - seen)) + error / np.sqrt(NEIGHBOURS)
    wrong = off > DOUBT * _smooth(expected)
    return int(wrong.argmax()) if wrong.any() else len(wrong)


def _power_of_two(least: float) -> int:
    """The smallest that is `least` or more, 1 at least."""
    return 1 << max(int(np.ceil(np.log2(max(least, 1)))), 0)


def _smooth(values: np.ndarray) -> np.ndarray:
    """Mean over NEIGHBOURS rungs; beyond the ends they are as the last one."""
    padded = np.pad(values, NEIGHBOURS // 2, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, NEIGHBOURS).mean(axis=1)
