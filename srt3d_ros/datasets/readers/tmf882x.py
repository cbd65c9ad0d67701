"""ams TMF882x (TMF8820, 8821, 8828 in its 3 × 3 modes): histograms as JSON, one object a capture.

    [{"hists": [9][128], "reference_hist": [128], "distances": [{"tick": …, …}], …}, …]

as the tools around https://github.com/uwgraphics/tmf882x write it. Verified on 80 captures of a TMF8820 before a plane
moved by a robot arm: the width of a bin, the shots, the ranges of the centre zone but for a constant.
Not verified, for want of a device: where the other zones look, delays between zones, other SPAD maps, ticks of 0.2 µs.
"""

from collections.abc import Iterator

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.core.sketching.photons import PhotonHistograms
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.datasets.values import whole_counts
from srt3d_ros.errors import require

NAME = "tmf882x"
ZONES, BINS = 9, 128
AS_SEEN = (2, 1, 0, 5, 4, 3, 8, 7, 6)       # the zones row by row, as a camera in the sensor's place sees them
BIN_WIDTH_S = 93.5e-12      # 14.02 mm, as measured on that plane from 30 mm on; the data sheet has 100 ps nominally
FOV_DEG = 41.0, 52.0        # across and down, of the wide 3 × 3 SPAD map
LEAD = 4                    # bins before the reference pulse's peak in which its light has not begun
TICK_NS = 200
MOST_SEEN = 0.999           # of the shots that reach a bin: beyond, the rate is anybody's guess


def frames(log: list, name: str) -> Iterator[Photons]:
    """The captures of a log; InvalidInput where one is broken."""
    require(len(log) > 0, name, "empty", "a list of captures")
    for k, capture in enumerate(log):
        yield of_capture(capture, f"{name} capture {k}")


def of_capture(capture: dict, name: str) -> Photons:
    """One capture: counts without pile-up, and its own reference pulse as IRF, so that a drift of time zero drops out.

    The zones' converters keep the first photon of a shot. How many shots there were is not in the log, but in the
    background (shots_of): with the plane at 100 mm it is half as bright behind the pulse as before.
    """
    require(isinstance(capture, dict), name, type(capture).__name__, "an object with hists and reference_hist")
    zones = whole_counts(f"{name} hists", capture.get("hists"), (ZONES, BINS))[list(AS_SEEN)]
    reference = whole_counts(f"{name} reference_hist", capture.get("reference_hist"), (BINS,))
    peak = int(reference.argmax())
    require(bool((reference >= 0).all()) and LEAD < peak, f"{name} reference_hist", f"with its peak in bin {peak}",
            f"counts of a pulse behind bin {LEAD}")
    shots = shots_of(zones, peak - LEAD)
    sensor = SensorModel(
        3, 3, BINS, BIN_WIDTH_S, without_pile_up(reference, shots), peak, toa_offset_bins=-peak,
        projection=Pinhole(*(1.5 / np.tan(np.radians(fov) / 2) for fov in FOV_DEG), 1, 1), frame_id=NAME)
    frame = PhotonHistograms(without_pile_up(zones, shots).reshape(3, 3, BINS), _stamp_ns(capture))
    return Photons(sensor, frame, None, NAME, ("ranges count from the reference pulse",))


def _stamp_ns(capture: dict) -> int:
    try:
        return int(capture["distances"][0]["tick"]) * TICK_NS
    except (LookupError, TypeError, ValueError, OverflowError):
        return 0


def without_pile_up(counts: np.ndarray, shots: float) -> np.ndarray:
    """Counts without pile-up, float32 as `counts` [..., bins]; `shots` N may be infinite.

    A converter that keeps the first photon of a laser shot misses those behind it. Of N shots, N − C_b reach bin b
    without a photon, C_b being the counts of the bins before. So bin b sees −ln(1 − c_b / (N − C_b)) photons a shot,
    and N times that is what a converter without dead time would have counted (P. B. Coates, "The correction for photon
    'pile-up' in the measurement of radiative lifetimes", J. Phys. E 1, 1968).

    Shots that are fewer than the counts of a pixel cannot be those of its converter; N is then as many as needed.
    """
    if not np.isfinite(shots):
        return counts.astype(np.float32)
    counts = counts.astype(np.float64)
    before = np.cumsum(counts, axis=-1) - counts
    shots = np.maximum(shots, (before[..., -1:] + counts[..., -1:]) / MOST_SEEN)
    return (-shots * np.log1p(-np.minimum(counts / (shots - before), MOST_SEEN))).astype(np.float32)


def shots_of(counts: np.ndarray, laser_bin: int) -> float:
    """N, told by the background: of its light the share 1 − S / N is left behind a pulse of S photons.

    Least squares of (rate before − rate behind) = rate before · S / N over the pixels.

    Args:
        counts: [pixels, bins], one converter a pixel, all with the same N.
        laser_bin: no laser light comes in the bins before it.

    Returns:
        N, or infinity if the background tells nothing: too dark, or no pulse.
    """
    ambient = counts[:, :laser_bin].mean(axis=1)
    behind = counts[:, -counts.shape[1] // 6:].mean(axis=1)        # far behind the pulse: its tail has ended
    pulse = ambient * np.maximum(counts.sum(axis=1) - counts.shape[1] * behind, 0)
    missing = float(((ambient - behind) * pulse).sum())
    # Photons of the background come by chance: N is known from what is missing to twice its standard deviation.
    spread = float(np.sqrt((pulse**2 * (ambient / laser_bin + behind / (counts.shape[1] // 6))).sum()))
    return float((pulse**2).sum()) / missing if missing > 2 * spread else np.inf
