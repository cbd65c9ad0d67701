"""With which gate and frequencies the photons of a frame are sketched."""

from typing import NamedTuple

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import AUTO as DESIGNED
from srt3d_ros.core.sketching.frequencies import RULES, choose
from srt3d_ros.core.sketching.frequency_design import Light
from srt3d_ros.core.sketching.gate import AUTO, FORM, OFF, Gate, parse
from srt3d_ros.core.sketching.light import light_of
from srt3d_ros.core.sketching.photons import PhotonFrame
from srt3d_ros.core.sketching.scene_histogram import histogram, occupied
from srt3d_ros.errors import require

# On each side of what is seen, as a part of it. Art, SBR 0.1, TD without a gate 88.0 %, with no margin 92.2, with this
# 92.2, with four times as much 91.5.
MARGIN = 1 / 8
# The part of the photons that a gate has to drop. With less background there is nothing to gain: at SBR 52 and 1 photon
# per pixel TD falls by 0.1 points, since other frequencies fit the shorter T.
WORTHWHILE = 1 / 10


class SketchDesign(NamedTuple):
    """A gate or None, the integers k_l for the T that it leaves, and the light before the gate if it was measured."""

    gate: Gate | None
    frequencies: tuple[int, ...]
    light: Light | None = None


def fixed_design(sensor: SensorModel, gate: str = OFF, frequencies: str = DESIGNED, sketch_size: int | None = None,
                 light: Light | None = None) -> SketchDesign:
    """The design for a sensor whose photons are not known, or of this light.

    Args:
        gate: off, or the first and the last bin, such as "100-400".
        frequencies, sketch_size: as of `choose`.

    Raises:
        InvalidInput: a gate or frequencies that do not fit the sensor.
    """
    bins = parse(gate)
    require(bins != AUTO, "gate", gate, FORM)
    if bins == OFF:
        return SketchDesign(None, choose(frequencies, sensor, sketch_size, light), light)
    chosen = Gate(sensor, *bins)
    seen = light and light.gated(chosen.sensor.num_bins / sensor.num_bins)
    return SketchDesign(chosen, choose(frequencies, chosen.sensor, sketch_size, seen), light)


def design_for(frame: PhotonFrame, sensor: SensorModel, gate: str = OFF, frequencies: str = DESIGNED,
               sketch_size: int | None = None) -> SketchDesign:
    """The design for the photons of a frame: also a gate "auto", the depths that stand out in their histogram.

    Raises:
        InvalidInput: a gate or frequencies that do not fit the sensor, or photons that are not its own.
    """
    light = light_of(frame, sensor) if frequencies == DESIGNED else None
    if gate != AUTO:
        return fixed_design(sensor, gate, frequencies, sketch_size, light)
    whole = fixed_design(sensor, OFF, frequencies, sketch_size, light)
    highest = len(whole.frequencies) if frequencies in RULES else max(whole.frequencies)    # the others follow T
    found = _gate_of(histogram(frame, sensor), sensor, highest)
    return whole if found is None else fixed_design(sensor, str(found), frequencies, sketch_size, light)


def _gate_of(counts: np.ndarray, sensor: SensorModel, highest: int) -> Gate | None:
    """The gate around what a histogram shows, with room for the IRF and `highest`; None if there is little to drop."""
    irf = np.atleast_2d(sensor.irf).mean(axis=0)
    pulse = max(round(1 / float(np.square(irf).sum())), 1)
    seen = occupied(counts, pulse)
    if seen is None:
        return None
    (first, last), most = seen, sensor.num_bins - 1
    margin = max(pulse, round(MARGIN * (last - first + 1)))
    least = max(sensor.irf.shape[-1], 2 * highest + 1)
    margin = max(margin, -(-(least - (last - first + 1)) // 2))
    first, last = max(min(first - margin, most + 1 - least), 0), min(max(last + margin, least - 1), most)
    inside = counts[first:last + 1].sum() / counts.sum()
    return Gate(sensor, first, last) if last - first + 1 >= least and inside <= 1 - WORTHWHILE else None
