"""The reconstruction methods by name: ours, and those that the SRT3D paper compares."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from srt3d_ros.core.baselines.rt3d import RT3D
from srt3d_ros.core.baselines.sketched import SMLE, SRT3D
from srt3d_ros.core.baselines.xcorr import XCORR
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import require

DEFAULT_METHOD = "pooled"


@dataclass(frozen=True)
class Method:
    """A reconstruction method.

    Args:
        name: as users write it.
        about: one line for help texts and tables.
        needs: "sketch", or "photons" if it needs every time of arrival.
        kind: its class.
        frequencies: default for `frequencies.choose_frequencies`.
        options: those besides `surfaces`.
    """

    name: str
    about: str
    needs: str
    kind: type
    frequencies: str = "auto"
    options: tuple[str, ...] = ()

    def build(self, sensor: SensorModel, frequencies: Sequence[int] = (), **options: Any) -> Any:
        """A callable from a Sketch, or from a PhotonFrame, to a Cloud.

        Args:
            sensor: geometry, IRF and calibration.
            frequencies: the integers k_l of the sketches; methods on photons ignore them.
            options: `surfaces`, those of `self.options`, and device="auto" or "cpu" for any method.

        Raises:
            InvalidInput: an unknown option, or a value that cannot be used.
        """
        known = ("surfaces", *self.options)
        if "device" not in known:
            device = options.pop("device", "auto")
            require(device in ("auto", "cpu"), "device", device, f"cpu or auto: {self.name} runs on the CPU")
        for option, value in options.items():
            require(option in known, option, problem=f"{option} {value}: {self.name} takes only {', '.join(known)}.")
        return self.kind(sensor, *((frequencies,) if self.needs == "sketch" else ()), **options)


METHODS = {method.name: method for method in (
    Method("pooled", "SRT3D's data term, summed over the neighbours on the same surface, where SRT3D smooths depths "
           "with APSS afterwards", "sketch", Pooled,
           options=("device", "false_alarm_rate", "background", "warm_start")),
    Method("srt3d", "SRT3D as published, gradient steps on pixels' sketches and an APSS denoiser", "sketch", SRT3D,
           "consecutive", ("device",)),
    Method("smle", "maximum likelihood on each pixel's sketch", "sketch", SMLE, "consecutive", ("device",)),
    Method("xcorr", "matched filter on each pixel's histogram, on the CPU", "photons", XCORR),
    Method("rt3d", "RT3D as published, gradient steps on every time of arrival and an APSS denoiser, on the CPU",
           "photons", RT3D),
)}
SKETCH_METHODS = tuple(method.name for method in METHODS.values() if method.needs == "sketch")


def find(name: str) -> Method:
    """The method of this name; InvalidInput lists all of them."""
    require(name in METHODS, "method", name, " or ".join(METHODS))
    return METHODS[name]
