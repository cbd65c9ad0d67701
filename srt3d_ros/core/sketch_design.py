"""SketchDesign: with which gate and frequencies a sensor's photons are sketched. What is `auto` follows the photons."""

import numpy as np

from srt3d_ros.core.frame_watch import FrameWatch, occupied
from srt3d_ros.core.frequencies import AUTO as DESIGNED
from srt3d_ros.core.frequencies import RULES, choose
from srt3d_ros.core.frequency_design import Light
from srt3d_ros.core.gate import AUTO, OFF, Gate, in_ranges, parse
from srt3d_ros.core.light_meter import LightMeter
from srt3d_ros.core.photons import PhotonFrame
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketching import Sketcher

# Between two changes. Each makes a reconstructor begin anew, which takes it the time of a few frames.
CHANGE_NS = 2_000_000_000
# On each side of what is seen, as a part of it: for movement between two looks. Art, SBR 0.1, TD without a gate 88.0 %,
# with no margin 92.2, with this 92.2, with four times as much 91.5.
MARGIN = 1 / 8
SMALLER = 2 / 3             # a gate that could be this much smaller becomes so; one that is left opens at once
# The part of the photons that a gate has to drop. With less background there is nothing to gain: at SBR 52 and 1 photon
# per pixel TD falls by 0.1 points, since other frequencies fit the shorter T.
WORTHWHILE = 1 / 10


class SketchDesign:
    """A gate and frequencies. Each frame passes through `look` and `end_frame`, which says when they have changed.

    They change after the first frame, and then at most once in CHANGE_NS.

    Args:
        source: the sensor whose photons come in.
        gate: off, auto, or the first and the last bin, such as "100:400".
        frequencies, sketch_size: as for `frequencies.choose`.
        window_frames: whose photons a sketch holds.

    Attributes:
        gate: the gate in force, or None.
        sensor: describes the photons that are kept.
        frequencies: the integers k_l, for the T of `sensor`.
        light: of the newest window that was looked at, before the gate; None without `auto` frequencies.

    Raises:
        InvalidInput: a gate or frequencies that do not fit the sensor.
    """

    def __init__(self, source: SensorModel, gate: str = OFF, frequencies: str = "auto", sketch_size: int | None = None,
                 window_frames: int = 1):
        self._source, self._settings = source, (gate, frequencies, sketch_size)
        self._spec, self._size = frequencies, sketch_size
        bins = parse(gate)
        self._follows_gate = bins == AUTO
        self.window_frames = window_frames
        self.light: Light | None = None
        self._lit: Light | None = None          # what the frequencies are for
        self._set(None if bins in (OFF, AUTO) else Gate(source, *bins))
        self._watch = FrameWatch(source) if self._follows_gate else None
        self._meter: LightMeter | None = None       # made when photons come: not to check parameters
        self._changed_ns: int | None = None

    def is_for(self, source: SensorModel, gate: str, frequencies: str, sketch_size: int | None) -> bool:
        """Whether it was made with these arguments."""
        return self._settings == (gate, frequencies, sketch_size) and self._source.same_as(source)

    def made(self, sketcher: Sketcher) -> bool:
        """Whether a sketcher has this gate and these frequencies."""
        own = str(self.gate), self.frequencies
        return (str(sketcher.gate), sketcher.frequencies) == own and sketcher.sensor.same_as(self._source)

    @property
    def in_words(self) -> str:
        """Gate, frequencies, and the light that they are for."""
        light = f" for {self._lit.in_words}" if self._lit else ""
        return f"gate {in_ranges(self.gate)}, {len(self.frequencies)} frequencies up to {max(self.frequencies)}{light}"

    @property
    def light_in_words(self) -> dict[str, str]:
        """The newest light by what it consists of; empty before there is one."""
        if self.light is None:
            return {}
        return {"photons_per_pixel": f"{self.light.photons_per_pixel:.3g}", "sbr": f"{self.light.sbr:.2g}"}

    def look(self, frame: PhotonFrame) -> None:
        """See the photons of a frame or packet, before any is dropped."""
        if self._meter is None and self._spec == DESIGNED:
            self._meter = LightMeter(self._source)
        for looking in filter(None, (self._watch, self._meter)):
            looking.add(frame)

    def forget(self) -> None:
        """Begin a new frame."""
        for looking in filter(None, (self._watch, self._meter)):
            looking.forget()

    def end_frame(self, stamp_ns: int) -> bool:
        """End the frame that was acquired at `stamp_ns`; whether gate or frequencies are others from now on."""
        histogram = self._watch.end_frame() if self._watch is not None else None
        light = self._meter.end_frame() if self._meter is not None else None
        if light is not None:
            self.light = light.of_frames(self.window_frames)
        if self._changed_ns is not None and abs(stamp_ns - self._changed_ns) < CHANGE_NS:
            return False
        before = str(self.gate), self.frequencies
        if self._asks_for_others():
            self._lit = self.light
            self._set(self.gate)
        if histogram is not None:
            self._set(self._followed(histogram))
        if before == (str(self.gate), self.frequencies):
            return False
        self._changed_ns = stamp_ns
        return True

    def _set(self, gate: Gate | None) -> None:
        self.gate, self.sensor = gate, self._source if gate is None else gate.sensor
        light = self._lit
        if light is not None and gate is not None:
            light = light.gated(self.sensor.num_bins / self._source.num_bins)
        self.frequencies = choose(self._spec, self.sensor, self._size, light)

    def _asks_for_others(self) -> bool:
        """Whether the light is not what the frequencies are for."""
        if self.light is None or self._lit is None:
            return self.light is not None
        highest = max(self.frequencies) * self._source.num_bins / self.sensor.num_bins      # of the source's period
        return self.light.is_other(self._lit, round(highest))

    def _followed(self, histogram: np.ndarray) -> Gate | None:
        """The gate that a histogram asks for; the present one while it holds what is seen and is not much too long."""
        irf = np.atleast_2d(self._source.irf).mean(axis=0)
        pulse = max(round(1 / float(np.square(irf).sum())), 1)
        seen = occupied(histogram, pulse)
        if seen is None:            # too little light to know: no gate
            return None
        first, last = seen
        margin = max(pulse, round(MARGIN * (last - first + 1)))
        most = self._source.num_bins - 1
        least = max(self._source.irf.shape[-1], 2 * self._highest() + 1)        # the IRF and frequencies have to fit in
        margin = max(margin, -(-(least - (last - first + 1)) // 2))
        wanted = max(min(first - margin, most + 1 - least), 0), min(max(last + margin, least - 1), most)
        bins, present = wanted[1] - wanted[0] + 1, self.gate
        if present is not None and present.first <= first and last <= present.last \
                and bins > SMALLER * (present.last - present.first + 1):
            return present
        inside = histogram[wanted[0]:wanted[1] + 1].sum() / histogram.sum()
        return Gate(self._source, *wanted) if bins >= least and inside <= 1 - WORTHWHILE else None

    def _highest(self) -> int:
        """The highest frequency that has to fit, of frequencies that follow T their number."""
        return len(self.frequencies) if self._spec in RULES else max(self.frequencies)


def design_for(frame: PhotonFrame, source: SensorModel, gate: str = OFF, frequencies: str = "auto",
               sketch_size: int | None = None) -> SketchDesign:
    """The design for one frame."""
    design = SketchDesign(source, gate, frequencies, sketch_size)
    design.look(frame)
    design.end_frame(frame.stamp_ns)
    return design
