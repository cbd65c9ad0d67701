"""The reconstruction methods by name, ours and those that the SRT3D paper compares, and their options."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypedDict

from srt3d_ros.core.baselines.rt3d import RT3D
from srt3d_ros.core.baselines.sketched import SMLE, SRT3D
from srt3d_ros.core.baselines.xcorr import XCORR
from srt3d_ros.core.keys import Key, keys
from srt3d_ros.core.method.background import BACKGROUNDS
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.method.thresholds import DEFAULT_FALSE_ALARM_RATE, MAX_FALSE_ALARM_RATE, MAX_SURFACES
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import require
from srt3d_ros.kernels.devices import DEVICES

DEFAULT_METHOD = "pooled"
MAX_WINDOW = 1000


@dataclass(frozen=True)
class Method:
    """A reconstruction method.

    Args:
        name: as users write it.
        about: one line for help texts and tables.
        needs: "sketch", or "photons" if it needs every time of arrival.
        kind: its class.
        frequencies: default for `frequencies.choose_frequencies`.
        options: those of `ReconstructorOptions` that it has, besides `method` and `surfaces`.
    """

    name: str
    about: str
    needs: str
    kind: type
    frequencies: str = "auto"
    options: tuple[str, ...] = ()

    def build(self, sensor: SensorModel, frequencies: Sequence[int] = (), **options: Any) -> Any:
        """A callable from a sketch, or from a PhotonFrame, to points.

        Args:
            sensor: geometry, IRF and calibration.
            frequencies: the integers k_l of the sketches; methods on photons ignore them.
            options: see `checked`.
        """
        checked({"method": self.name} | options)
        own = {name: value for name, value in options.items() if name in ("surfaces", *self.options)}
        return self.kind(sensor, *((frequencies,) if self.needs == "sketch" else ()), **own)


METHODS = {method.name: method for method in (
    Method("pooled", "SRT3D's data term, summed over the neighbours on the same surface, where SRT3D smooths depths "
           "with APSS afterwards", "sketch", Pooled,
           options=("device", "false_alarm_rate", "background", "window_frames")),
    Method("srt3d", "SRT3D as published, gradient steps on pixels' sketches and an APSS denoiser", "sketch", SRT3D,
           "consecutive", ("device",)),
    Method("smle", "maximum likelihood on each pixel's sketch", "sketch", SMLE, "consecutive", ("device",)),
    Method("xcorr", "matched filter on each pixel's histogram, on the CPU", "photons", XCORR),
    Method("rt3d", "RT3D as published, gradient steps on every time of arrival and an APSS denoiser, on the CPU",
           "photons", RT3D),
)}
SKETCH_METHODS = tuple(method.name for method in METHODS.values() if method.needs == "sketch")


class MethodOptions(TypedDict, total=False):
    """How to reconstruct a frame."""

    method: Annotated[str, Key("how to reconstruct: docs/algorithm.md", choices=tuple(METHODS), default=DEFAULT_METHOD)]
    surfaces: Annotated[int, Key("most surfaces per pixel", bounds=(1, MAX_SURFACES), default=1)]
    device: Annotated[str, Key("where to compute; auto: on a GPU if it gives the same points faster", choices=DEVICES,
                               default="auto")]
    false_alarm_rate: Annotated[float, Key(
        "fraction of the pixels without a surface that may show a false point (pooled)",
        bounds=(1e-12, MAX_FALSE_ALARM_RATE), default=DEFAULT_FALSE_ALARM_RATE)]
    background: Annotated[str, Key(
        "distribution of the background over the bins (pooled). auto: estimated from the photons that clouds do not "
        "explain; even until that is significant. sensor: the sensor's background_shape, or even without one. flat: "
        "even", choices=BACKGROUNDS, default=BACKGROUNDS[0])]


class ReconstructorOptions(MethodOptions, total=False):
    """How to reconstruct successive frames."""

    window_frames: Annotated[int, Key(
        "frames (not messages) that count in a cloud, newer ones more (pooled): more points and less error, but what "
        "moves in the scene smears. If the sensor moves: docs/motion.md", bounds=(1, MAX_WINDOW), default=1)]


OPTIONS = keys(ReconstructorOptions)


def find(name: str) -> Method:
    """The method of this name; InvalidInput lists all of them."""
    return METHODS[OPTIONS["method"].check(name)]


def checked(options: Mapping[str, Any]) -> Method:
    """The method of these options; InvalidInput if one cannot be used, or is not the default of one that it lacks."""
    method = find(options["method"])
    for name, value in options.items():
        if name == "device" and "device" not in method.options:
            require(value in ("auto", "cpu"), name, value, f"cpu or auto: {method.name} runs on the CPU")
        elif name not in ("method", "surfaces", *method.options):
            is_default = name in OPTIONS and value == OPTIONS[name].default
            require(is_default, name, problem=f"{name} {value}: {method.name} takes only "
                    f"{', '.join(('surfaces', *method.options))}.")
        else:
            OPTIONS[name].check(value)
    return method
