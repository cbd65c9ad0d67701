"""HistogramBins: where the bins of a histogramming sensor lie, and the photons in them that are not of the scene."""

from dataclasses import dataclass, replace

import numpy as np

from srt3d_ros.errors import finite, require

HALF_BIN = 0.5              # tolerance for the end of the last bin, against rounding


@dataclass(frozen=True, eq=False)
class HistogramBins:
    """Bin j of each pixel's histogram spans `bin_width` bins of the sensor's axis from `first_bin` + j · `bin_width`.

    Without it a histogram has the sensor's T bins. `delay_bins` describes pixels whose bins begin later. Photons count
    as in the middle of their bin, so give an IRF that includes the width of these bins.

    Args:
        num_bins: n, bins of a histogram.
        first_bin: where bin 0 begins, in bins of the axis from the beginning of its bin 0; 0 or more.
        bin_width: bins of the axis in one bin of the histogram.
        template: float32 [n], or [rows · cols, n], 0 or more: photons in each bin of every message that are not from
            the scene (crosstalk, the pulse of a cover glass). They are subtracted. Bins far above the template's mean
            are left out of sketches, because subtraction does not remove noise.
    """

    num_bins: int
    first_bin: float = 0.0
    bin_width: float = 1.0
    template: np.ndarray | None = None

    def __eq__(self, other) -> bool:
        return isinstance(other, HistogramBins) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in self.__dataclass_fields__)

    def check(self, rows: int, cols: int, num_bins: int) -> None:
        """Raise InvalidInput unless the bins lie on the axis of a sensor of this size."""
        n = self.num_bins
        require(type(n) is int and 1 <= n <= num_bins, "histograms.num_bins", n, f"an integer from 1 to {num_bins}, T")
        first, width = (finite(f"histograms.{name}", getattr(self, name), "a number of bins")
                        for name in ("first_bin", "bin_width"))
        require(width > 0, "histograms.bin_width", width, "above 0 bins")
        require(first >= 0, "histograms.first_bin", first, "0 or more bins")
        end = first + n * width
        require(end <= num_bins + HALF_BIN, "histograms", f"{n} bins that end at {end:g}", f"at most T = {num_bins}")
        if self.template is not None:
            value = np.asarray(self.template)
            require(value.shape in ((n,), (rows * cols, n)), "histograms.template shape", value.shape,
                    f"({n},), or ({rows * cols}, {n}) for one of each pixel")
            require(bool((np.isfinite(value) & (value >= 0)).all()), "histograms.template",
                    "negative or not finite in places", "photons, 0 or more")

    def centers(self) -> np.ndarray:
        """The middle of every bin on the axis; float64 [n]."""
        return self.first_bin + (np.arange(self.num_bins) + 0.5) * self.bin_width

    def cropped(self, rows: slice, cols: slice, shape: tuple[int, int]) -> "HistogramBins":
        """The bins of the pixels `rows`, `cols` of a sensor of this shape."""
        if np.ndim(self.template) < 2:
            return self
        template = np.reshape(self.template, (*shape, -1))[rows, cols].reshape(-1, self.num_bins)
        return replace(self, template=template)
