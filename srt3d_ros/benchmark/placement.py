"""Where a frame lies when its clock starts and ends: in the host's memory, or already on the device.

The one place that knows how a backend is handed data on its device. A reconstructor, or a Sketcher, that can be has

    resident(frame) -> a function without arguments that does the frame's work with everything on the device

and is then measured both ways.
"""

import inspect
from collections.abc import Callable

from srt3d_ros.core.methods import Method
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketching import Sketcher
from srt3d_ros.errors import InvalidInput

HOST, DEVICE = "host", "device"


def built(method: Method, sensor: SensorModel, frequencies, device: str):
    """A warm reconstructor on the device, or on the CPU if the method knows no other; its `device` says which."""
    try:
        reconstructor = method.build(sensor, frequencies, device=device)
    except InvalidInput:
        if device == "cpu":
            raise
        reconstructor = method.build(sensor, frequencies, device="cpu")
    reconstructor.warm_up()
    return reconstructor


def reconstructions(reconstructor, frame) -> dict[str, Callable[[], object]]:
    """What to time, by where the frame lies: from and to the host and, where that is possible, all on the device."""
    return {HOST: lambda: reconstructor(frame), **_resident(reconstructor, frame)}


def sketcher_on(sensor: SensorModel, frequencies, device: str) -> tuple[Sketcher, str]:
    """A Sketcher on the device, if it can be there, and where it is."""
    if device != "cpu" and "device" in inspect.signature(Sketcher).parameters:
        return Sketcher(sensor, frequencies, device=device), device
    return Sketcher(sensor, frequencies), "cpu"


def sketched(photons: PhotonEvents, sensor: SensorModel, frequencies, device: str) -> Sketch:
    """The sketch of a frame in the host's memory, made where it is quickest."""
    sketcher, _ = sketcher_on(sensor, frequencies, device)
    sketcher.add(photons)
    return sketcher.sketch()


def sketchings(sketcher: Sketcher, frame, anew: Callable[[object], object]) -> dict[str, Callable[[], object]]:
    """What to time, as for `reconstructions`; `anew` makes the frame one of which nothing is known yet."""
    return {HOST: lambda: sketcher.add(anew(frame)), **_resident(sketcher, frame)}


def _resident(worker, frame) -> dict[str, Callable[[], object]]:
    resident = getattr(worker, "resident", None)
    return {} if resident is None else {DEVICE: resident(frame)}
