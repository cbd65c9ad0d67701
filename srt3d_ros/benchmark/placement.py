"""Works by where a frame lies when its clock starts: in the host's memory or, where there is a GPU, already on it too.

On a GPU a Sketcher gives sketches whose arrays are tensors, which a reconstructor there takes as they are; the
sketcher's `resident(frame)` copies photons there before they are sketched; and a reconstructor with `submit` begins a
frame while others are in progress.
"""

import numpy as np

from srt3d_ros.benchmark.timing import Work
from srt3d_ros.core.methods import Method
from srt3d_ros.core.photons import PhotonEvents, PhotonFrame, PhotonGates
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketching import Sketcher
from srt3d_ros.errors import InvalidInput

HOST, DEVICE, PIPELINED = "host", "device", "host, pipelined"
PIPELINED_FRAMES = 16       # in a call


def built(method: Method, sensor: SensorModel, frequencies, device: str):
    """A warm reconstructor on the device, or on the CPU if the method knows no other; its `device` says which."""
    try:
        reconstructor = method.build(sensor, frequencies, device=device)
    except InvalidInput:
        if device == "cpu":
            raise
        return built(method, sensor, frequencies, "cpu")
    reconstructor.warm_up()
    return reconstructor


def sketched(photons: PhotonEvents, sensor: SensorModel, frequencies, device: str) -> Sketch:
    """The sketch of a frame, its arrays on the device."""
    sketcher = Sketcher(sensor, frequencies, device=device)
    sketcher.add(photons)
    return sketcher.sketch()


def reconstructions(reconstructor, sketch: Sketch, title: str, facts: dict) -> list[Work]:
    """The reconstruction of a sketch, from each place where the sketch can lie.

    A pipelined call is of PIPELINED_FRAMES frames, each cloud awaited when the next frame has been submitted.
    """
    held, on_cpu = sketch.on_host(), reconstructor.device == "cpu"
    calls = {HOST: lambda: reconstructor(held)}
    if not on_cpu and not isinstance(sketch.sums, np.ndarray):
        calls[DEVICE] = lambda: reconstructor(sketch)
    if not on_cpu and hasattr(reconstructor, "submit"):
        calls[PIPELINED] = lambda: _stream(reconstructor, held)
    return [Work(call, title, facts | {"device": reconstructor.device, "frame_from": place},
                 PIPELINED_FRAMES if place == PIPELINED else 1) for place, call in calls.items()]


def _stream(reconstructor, sketch: Sketch) -> None:
    wait = reconstructor.submit(sketch)
    for _ in range(PIPELINED_FRAMES - 1):
        following = reconstructor.submit(sketch)
        wait()
        wait = following
    wait()


def sketchings(sketcher: Sketcher, frame: PhotonFrame, title: str, facts: dict) -> list[Work]:
    """The sketching of a frame, from each place where the frame can lie."""
    works = [Work(lambda: sketcher.add(_fresh_copy(frame)), title, facts | {"frame_from": HOST})]
    if hasattr(sketcher, "resident"):
        works.append(Work(sketcher.resident(frame), title, facts | {"frame_from": DEVICE}))
    return works


def _fresh_copy(frame: PhotonFrame) -> PhotonFrame:
    """The same photons as a frame that has just arrived: whether they are sorted is not known yet."""
    return PhotonEvents(frame.pixel, frame.toa) if isinstance(frame, PhotonEvents) else PhotonGates(frame.words)
