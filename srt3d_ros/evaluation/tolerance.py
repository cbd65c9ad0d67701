"""The tolerance τ: the largest depth error of a true detection."""

from dataclasses import dataclass, field, replace

from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import InvalidInput, require


@dataclass(frozen=True)
class Tolerance:
    """τ in bins or in millimetres of range; `other` has values for single sources, by name."""

    bins: float | None = None
    mm: float | None = None
    other: dict[str, "Tolerance"] = field(default_factory=dict)

    def in_bins(self, source: str, sensor: SensorModel) -> float:
        """τ of a source in the bins of its sensor."""
        chosen = self.other.get(source, self)
        return chosen.bins if chosen.mm is None else chosen.mm * 1e-3 / sensor.bin_width_m

    @classmethod
    def parse(cls, text: str) -> "Tolerance":
        """From "10", "40mm", or with other values for some files: "10,two_layer=40,face=5mm"."""
        parts = [part.strip() for part in text.split(",")]
        named = [part for part in parts if "=" in part]
        plain = [part for part in parts if "=" not in part]
        require(len(plain) == 1, "tolerance", text, "one value, and others as NAME=VALUE: 10,two_layer=40")
        other = {name: _single(value, text) for name, value in (part.rsplit("=", 1) for part in named)}
        return replace(_single(plain[0], text), other=other)


def _single(value: str, text: str) -> Tolerance:
    number = value.removesuffix("mm")
    try:
        found = float(number)
    except ValueError:
        raise InvalidInput("tolerance", text, "bins such as 10, or millimetres such as 40mm") from None
    require(0 < found < float("inf"), "tolerance", text, "a distance above 0")
    return Tolerance(mm=found) if value.endswith("mm") else Tolerance(bins=found)
