"""HistogramBins: where the bins of a histogramming sensor lie, and the photons in them that are not of the scene."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from srt3d_ros.core.keys import Key, documented, numbers
from srt3d_ros.errors import require

MAX_BINS = 65_536           # of a sensor: ToA have 16 bits
HALF_BIN = 0.5              # tolerance for the end of the last bin, against rounding


@documented
@dataclass(frozen=True, eq=False)
class HistogramBins:
    """Bin j of each pixel's histogram spans the sensor's bins from first_bin + j · bin_width on.

    Photons are taken to lie in its middle: give an IRF as wide as these bins make it.
    """

    num_bins: Annotated[int, Key("n, bins of a histogram", "bin", more="1 to the sensor's num_bins")]
    first_bin: Annotated[float, Key(
        "where bin 0 of the histogram begins, from the beginning of the sensor's bin 0", "bin", (0, MAX_BINS),
        "delay_bins shifts single pixels")] = 0.0
    bin_width: Annotated[float, Key("the sensor's bins in a bin of the histogram", "bin", (1e-6, MAX_BINS))] = 1.0
    template: Annotated[np.ndarray | None, Key(
        "photons in each bin of every message that do not come from the scene (crosstalk, a cover glass)", "photon",
        more="they are subtracted, and bins far above their mean are left out of sketches; default: none",
        dtype="float32", shape="[n] for all pixels, or [rows · cols, n]", array="histogram_template")] = None

    def check(self, pixels: int, num_bins: int) -> None:
        """Raise InvalidInput unless the bins lie on the axis of a sensor of this size."""
        n = self.num_bins
        require(type(n) is int and 1 <= n <= num_bins, "histograms.num_bins", n, f"an integer from 1 to {num_bins}, T")
        _, first, width = numbers(self, "histograms.").values()
        end = first + n * width
        require(end <= num_bins + HALF_BIN, "histograms", f"{n} bins that end at {end:g}", f"at most T = {num_bins}")
        if self.template is not None:
            value = np.asarray(self.template)
            require(value.shape in ((n,), (pixels, n)), "histograms.template shape", value.shape,
                    f"({n},), or ({pixels}, {n}) for one of each pixel")
            require(bool((np.isfinite(value) & (value >= 0)).all()), "histograms.template",
                    "negative or not finite in places", "photons, 0 or more")

    def centers(self) -> np.ndarray:
        """The middle of every bin on the axis; float64 [n]."""
        return self.first_bin + (np.arange(self.num_bins) + 0.5) * self.bin_width

    def cropped(self, rows: slice, cols: slice, shape: tuple[int, int]) -> "HistogramBins":
        """The bins of the pixels `rows`, `cols` of a sensor of this shape."""
        if self.template is None or np.ndim(self.template) < 2:
            return self
        template = np.reshape(self.template, (*shape, -1))[rows, cols].reshape(-1, self.num_bins)
        return replace(self, template=template)
