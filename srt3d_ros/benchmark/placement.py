"""Where a frame lies when its clock starts: in the host's memory, or already on the device.

The one place that knows how a backend is handed data on its device:
- A reconstructor with `submit` begins a frame while others are under way, which on the CPU gains nothing.
- A Sketcher on "cuda" gives sketches whose arrays are tensors there; a reconstructor there takes them as they are.
- A Sketcher that can sketch photons which are already there has `resident(frame)`, which copies a frame to the device
  and returns a function without arguments that sketches it.
What can be is measured both ways.
"""

from collections.abc import Callable

import numpy as np

from srt3d_ros.core.methods import Method
from srt3d_ros.core.photons import PhotonEvents, PhotonFrame
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketching import Sketcher
from srt3d_ros.errors import InvalidInput

HOST, DEVICE, PIPELINED = "host", "device", "host, pipelined"
FRAMES = {PIPELINED: 16}    # in a call; of the others one


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


def sketched(photons: PhotonEvents, sensor: SensorModel, frequencies, device: str) -> Sketch:
    """The sketch of a frame, its arrays on the device."""
    sketcher = Sketcher(sensor, frequencies, device=device)
    sketcher.add(photons)
    return sketcher.sketch()


def reconstructions(reconstructor, sketch: Sketch) -> dict[str, Callable[[], object]]:
    """What to time, by where the sketch lies: on the host and, if the reconstructor is where `sketch` is, there.

    A pipelined call is of FRAMES[PIPELINED] frames, each cloud awaited when the next frame has been submitted.
    """
    held = sketch.on_host()
    calls = {HOST: lambda: reconstructor(held)}
    if reconstructor.device == "cpu":
        return calls
    if not isinstance(sketch.sums, np.ndarray):
        calls[DEVICE] = lambda: reconstructor(sketch)
    if hasattr(reconstructor, "submit"):
        calls[PIPELINED] = lambda: _stream(reconstructor, held)
    return calls


def _stream(reconstructor, sketch: Sketch) -> None:
    wait = reconstructor.submit(sketch)
    for _ in range(FRAMES[PIPELINED] - 1):
        following = reconstructor.submit(sketch)
        wait()
        wait = following
    wait()


def sketchings(sketcher: Sketcher, frame: PhotonFrame,
               anew: Callable[[PhotonFrame], PhotonFrame]) -> dict[str, Callable[[], object]]:
    """What to time, as for `reconstructions`; `anew` makes the frame one of which nothing is known yet."""
    calls = {HOST: lambda: sketcher.add(anew(frame))}
    resident = getattr(sketcher, "resident", None)
    return calls if resident is None else calls | {DEVICE: resident(frame)}
