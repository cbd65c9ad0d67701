"""The reconstructor's parameters: what they are, which go together, and the reconstruction that they make."""

from collections.abc import Callable

import numpy as np

from srt3d_ros.core.background import BACKGROUNDS
from srt3d_ros.core.cloud import SURFACE_ORDERS
from srt3d_ros.core.device import DEVICES
from srt3d_ros.core.methods import DEFAULT_METHOD, METHODS, SKETCH_METHODS
from srt3d_ros.core.pooled import DEFAULT_FALSE_ALARM_RATE, MAX_SURFACES
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import require
from srt3d_ros.nodes.parameters import Parameter, Value

ANY_SENSOR = SensorModel(rows=8, cols=8, num_bins=64, bin_width_s=1e-9, irf=np.ones(3))
PARAMETERS = (
    Parameter("method", DEFAULT_METHOD, "How to reconstruct. " + "; ".join(
        f"{name}: {METHODS[name].about}" for name in SKETCH_METHODS) + ". All but pooled are published with the "
        "sketcher's `frequencies` consecutive.", choices=SKETCH_METHODS, live=True),
    Parameter("surfaces", 1, "Most surfaces per pixel.", low=1, high=MAX_SURFACES, live=True),
    Parameter("surface_order", "strongest", "Which surface of a pixel comes first in `points`. Images and organised "
              "clouds show only that one. With `surfaces` of 2 or more, nearest shows a net or fog, and farthest what "
              "is behind it.", choices=tuple(SURFACE_ORDERS), live=True),
    Parameter("false_alarm_rate", DEFAULT_FALSE_ALARM_RATE, "pooled, smle: fraction of the pixels without a surface "
              "that may show a false point.", low=1e-12, high=0.5, live=True),
    Parameter("background", BACKGROUNDS[0], "pooled: distribution of the background over the bins. auto: what the "
              "last clouds left unexplained, or even while that is not significant. sensor: the sensor's "
              "background_shape, or even without one. flat: even.", choices=BACKGROUNDS, live=True),
    Parameter("warm_start", False, "pooled: start from the last frame's surfaces where the photons confirm them. This "
              "reduces the error while the scene changes little.", live=True),
    Parameter("device", "auto", "Where to compute. auto: on a GPU if there is one.", choices=DEVICES, live=True),
    Parameter("fields", "xyzi", "Fields of `points`. xyzi: x, y, z, intensity. full: also depth_std, background, row, "
              "col and surface.", choices=("xyzi", "full"), live=True),
    Parameter("organised", False, "true: `points` as rows × cols with the first point of each pixel, NaN where there "
              "is none. false: a list of all points.", live=True),
    Parameter("min_range_m", 0.0, "Omit points nearer than this along their pixel's ray, from `points` and images; 0 "
              "= no limit.", "m", low=0.0, live=True),
    Parameter("max_range_m", 0.0, "Omit points farther than this; 0 = no limit.", "m", low=0.0, live=True),
    Parameter("save_folder", "", "Folder for `~/save_cloud`, which writes .ply; the working directory if empty.",
              form="a folder that exists"),         # not live: whoever starts the node decides where files go
)
DEFAULTS = {parameter.name: parameter.default for parameter in PARAMETERS}
OPTIONS = tuple(sorted({name for method in SKETCH_METHODS for name in METHODS[method].options}))


def check_together(values: dict[str, Value]) -> None:
    """Raise InvalidInput for values that are possible each, but not together."""
    method, nearest, farthest = METHODS[values["method"]], values["min_range_m"], values["max_range_m"]
    for name in OPTIONS:
        require(name in method.options or values[name] == DEFAULTS[name], name, values[name],
                f"{DEFAULTS[name]}, as {method.name} has no such option")
    require(farthest == 0 or nearest < farthest, "min_range_m", nearest, f"less than max_range_m, {farthest:g} m")


def limits_m(values: dict[str, Value]) -> tuple[float, float]:
    """The least and the greatest range of a point, metres."""
    return values["min_range_m"], values["max_range_m"] or np.inf


def options(values: dict[str, Value]) -> dict[str, Value]:
    """The values on which the reconstruction itself depends."""
    names = ("method", "surfaces", "device", *METHODS[values["method"]].options)
    return {name: values[name] for name in names}


def build(described: tuple[SensorModel, tuple[int, ...]] | None, values: dict[str, Value]) -> Callable:
    """The reconstruction that these parameters ask for; InvalidInput if there is none.

    Args:
        described: sensor and frequencies of the sketches; None while they are not known: of any.
    """
    chosen = options(values)
    return METHODS[chosen.pop("method")].build(*(described or (ANY_SENSOR, (1, 2, 3))), **chosen)
