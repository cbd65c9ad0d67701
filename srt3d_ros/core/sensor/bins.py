"""HistogramBins: where the bins of a histogramming sensor lie, and what is in them that the scene did not send."""

from dataclasses import dataclass, replace

import numpy as np

from srt3d_ros.errors import require

MAX_TABLE = 2**22           # bins of all pixels, where pixels' bins differ: a table of 370 MB for m = 10
HALF_BIN = 0.5              # by which rounding may put the last bin's end beyond the axis


@dataclass(frozen=True, eq=False)
class HistogramBins:
    """Bin j of a pixel's histogram spans the bins from `first_bin` + j · `bin_width` of the sensor's axis.

    Without it a histogram has the sensor's T bins. Photons are taken to lie in the middle of their bin, so give an IRF
    that is as wide as these bins make it.

    Args:
        num_bins: n, bins of a histogram.
        first_bin: float, or float32 [rows, cols]: where bin 0 begins, in bins of the axis from the beginning of its
            bin 0; 0 or more.
        bin_width: float, or float32 [rows, cols]: bins of the axis in one bin of the histogram.
        template: float32 [n], or [rows · cols, n]: photons in each bin of every message that do not come from the scene
            (crosstalk, the pulse of a cover glass), which are subtracted; 0 or more. Bins far above its mean are left
            out of a sketch, as their noise stays. None for none.
    """

    num_bins: int
    first_bin: float | np.ndarray = 0.0
    bin_width: float | np.ndarray = 1.0
    template: np.ndarray | None = None

    def __eq__(self, other) -> bool:
        return isinstance(other, HistogramBins) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in self.__dataclass_fields__)

    def check(self, rows: int, cols: int, num_bins: int) -> None:
        """Raise InvalidInput unless the bins lie on the axis of a sensor of this size."""
        n, shape = self.num_bins, (rows, cols)
        require(type(n) is int and 1 <= n <= num_bins, "histograms.num_bins", n, f"an integer from 1 to {num_bins}, T")
        for name in ("first_bin", "bin_width"):
            value = np.asarray(getattr(self, name))
            require(value.dtype.kind in "iuf" and value.shape in ((), shape), f"histograms.{name}",
                    f"{value.dtype} {value.shape}", f"a number, or numbers [rows, cols] = {shape}")
            require(bool(np.isfinite(value).all()), f"histograms.{name}", "not finite in places", "bins")
        first, width = np.asarray(self.first_bin, np.float64), np.asarray(self.bin_width, np.float64)
        require(bool((width > 0).all()), "histograms.bin_width", float(width.min()), "above 0 bins")
        require(bool((first >= 0).all()), "histograms.first_bin", float(first.min()), "0 or more bins")
        end = float((first + n * width).max())
        require(end <= num_bins + HALF_BIN, "histograms", f"{n} bins that end at {end:g}", f"at most T = {num_bins}")
        require(not self.differ or rows * cols * n <= MAX_TABLE, "histograms", f"{rows * cols} × {n} bins of their own",
                f"at most {MAX_TABLE}, or the same bins for all pixels")
        if self.template is not None:
            value = np.asarray(self.template)
            require(value.shape in ((n,), (rows * cols, n)), "histograms.template shape", value.shape,
                    f"({n},), or ({rows * cols}, {n}) for one of each pixel")
            require(bool((np.isfinite(value) & (value >= 0)).all()), "histograms.template",
                    "negative or not finite in places", "photons, 0 or more")

    @property
    def differ(self) -> bool:
        """Whether pixels have other bins than their neighbours."""
        return any(np.size(value) > 1 and np.ptp(value) > 0 for value in (self.first_bin, self.bin_width))

    def centers(self) -> np.ndarray:
        """Where the middle of every bin lies on the axis; float64 [n], or [rows · cols, n] if pixels differ."""
        first, width = (np.asarray(value, np.float64).reshape(-1, 1) for value in (self.first_bin, self.bin_width))
        if not self.differ:
            first, width = first[:1], width[:1]
        centers = first + (np.arange(self.num_bins) + 0.5) * width
        return centers if self.differ else centers[0]

    def cropped(self, rows: slice, cols: slice, shape: tuple[int, int]) -> "HistogramBins":
        """The bins of the pixels `rows`, `cols` of a sensor of this shape."""
        first, width = (value[rows, cols] if np.ndim(value) == 2 else value
                        for value in (self.first_bin, self.bin_width))
        template = self.template
        if np.ndim(template) == 2:
            template = np.reshape(template, (*shape, -1))[rows, cols].reshape(-1, self.num_bins)
        return replace(self, first_bin=first, bin_width=width, template=template)
