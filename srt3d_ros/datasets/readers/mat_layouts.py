"""How published .mat files hold their photons. To read another kind of file, add its `Layout`."""

from typing import NamedTuple

import numpy as np

EXPECTED = "a MATLAB 5 .mat file, whole (save -v7)"
CELLS, COUNTS, SPARSE = "[rows, cols] cell", "[T, rows·cols] counts", "sparse [rows·cols, T] counts"
CUBE = "any other numeric array [rows, cols, bins]"


class Layout(NamedTuple):
    """How one published kind of file holds its photons.

    Args:
        variable: name of the array of photons.
        bin_width_s: where the file does not say; what the authors say, or inferred from their description.
        form: CELLS of ToA lists, COUNTS of photons per bin or SPARSE ones, which mat_child turns into COUNTS; pixels of
            counts in MATLAB's column-major order.
        picoseconds: ToA are times in picoseconds, not bins.
        window: scalars that hold the first and last ToA of the measured window.
        reference: array [rows, cols] of reference depths, numbered from 1 as MATLAB does.
    """

    variable: str
    bin_width_s: float
    form: str = CELLS
    picoseconds: bool = False
    window: tuple[str, ...] = ()
    reference: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """All variables."""
        return self.variable, *self.window, *filter(None, (self.reference,))

    def fits(self, found: dict[str, np.ndarray]) -> bool:
        """Whether the variables of a file (mat_child.variables) are in this form."""
        if self.form == CELLS:
            return f"{self.variable}.lengths" in found
        counts = found.get(self.variable, np.zeros(0))
        return counts.ndim == 2 and counts.dtype.kind in "iuf" and f"{self.variable}.lengths" not in found


LAYOUTS = (
    Layout("Y", 16e-12, COUNTS, reference="DepthImage"),        # Heriot-Watt polystyrene head
    Layout("photon_times", 8e-12),                              # MIT, two layers (Shin et al., Opt. Express 2016)
    Layout("Ts", 8e-12),                                        # MIT, mannequin face (Shin et al., IEEE TCI 2015)
    Layout("data_processed", 100e-12, picoseconds=True,         # USTC, tower at 9.8 km (Li et al., Optica 2021);
           window=("mm", "MM")),                                # the bin width is our choice
    Layout("spad", 80e-12, SPARSE, reference="bin"),            # simulated: Lindell et al., SIGGRAPH 2018
)
WANTED = "; ".join([*(f"{one.variable} ({one.form})" for one in LAYOUTS), CUBE])
