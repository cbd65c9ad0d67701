"""Light: what the photons of a frame say of themselves, as far as a choice of frequencies depends on it."""

from dataclasses import dataclass, replace

import numpy as np

from srt3d_ros.core.frequency_design import SCORES

# Pixels whose photons a design counts together, as a reconstruction pools those around each point. Mean DAE of 36
# frames: −7.4 % with 1, −8.5 with 2, −8.9 with 4, −9.4 with 16, which is up to 1 % worse in places.
POOLED = 4
STEP = 0.75         # octaves from which on the light is another one: beyond half of one, at which a design changes
MORE = 1.2          # and the factor of the frequency up to which it is confirmed: two rungs of the meter


@dataclass(frozen=True)
class Light:
    """The light of a frame.

    Args:
        photons_per_pixel: mean over the pixels in use.
        signal_share: expected signal photons over all photons of a pixel, 0 … 1; 0 if none can be seen.
        confirmed: the highest frequency k up to which the photons are as the IRF says; 0 if they are not, or too few.
    """

    photons_per_pixel: float
    signal_share: float
    confirmed: int

    @property
    def sbr(self) -> float:
        """Signal over background photons, 0 … infinite."""
        return self.signal_share / (1 - self.signal_share) if self.signal_share < 1 else np.inf

    @property
    def in_words(self) -> str:
        """Photons and SBR."""
        return f"{self.photons_per_pixel:.3g} photons per pixel at SBR {self.sbr:.2g}"

    def octaves(self, sketch_size: int) -> float:
        """How often the photons have doubled over those that are just enough for SCORES; below 0 if they are fewer.

        The score of s signal and b background photons is s √(2m / (s + b)): the square root of photons.
        """
        score = self.signal_share * np.sqrt(2 * sketch_size * POOLED * self.photons_per_pixel)
        return float(2 * np.log2(max(score, 1e-3) / SCORES[-1]))

    def gated(self, bins: float) -> "Light":
        """The light if all signal but only this part of the bins is kept."""
        kept = self.signal_share + (1 - self.signal_share) * bins
        return Light(self.photons_per_pixel * kept, self.signal_share / kept, int(self.confirmed * bins))

    def of_frames(self, frames: int) -> "Light":
        """The light of several such frames together."""
        return replace(self, photons_per_pixel=self.photons_per_pixel * frames)

    def is_other(self, before: "Light", top: int) -> bool:
        """Whether it asks for another design than one with a highest frequency of `top`, made for the light before."""
        moved = abs(self.octaves(1) - before.octaves(1)) > STEP
        return moved or self.confirmed < top <= before.confirmed or self.confirmed > MORE * before.confirmed
