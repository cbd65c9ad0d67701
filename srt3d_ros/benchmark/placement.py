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
        reconstructor = method.build(sensor, frequencies, device="cpu")
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
    held, facts = sketch.on_host(), facts | {"device": reconstructor.device}
    works = [Work(lambda: reconstructor(held), title, facts | {"frame_from": HOST})]
    if reconstructor.device != "cpu":
        if not isinstance(sketch.sums, np.ndarray):
            works.append(Work(lambda: reconstructor(sketch), title, facts | {"frame_from": DEVICE}))
        if hasattr(reconstructor, "submit"):
            works.append(Work(lambda: _stream(reconstructor, held), title, facts | {"frame_from": PIPELINED},
                              PIPELINED_FRAMES))
    return works


def _stream(reconstructor, sketch: Sketch) -> None:
    wait = reconstructor.submit(sketch)
    for _ in range(PIPELINED_FRAMES - 1):
        following = reconstructor.submit(sketch)
        wait()
        wait = following
    wait()


def sketchings(sketcher: Sketcher, frame: PhotonFrame, title: str, facts: dict) -> list[Work]:
    """The sketching of a frame, from each place where the frame can lie."""
    works = [Work(lambda: sketcher.add(fresh_copy(frame)), title, facts | {"frame_from": HOST})]
    if hasattr(sketcher, "resident"):
        works.append(Work(sketcher.resident(frame), title, facts | {"frame_from": DEVICE}))
    return works


def fresh_copy(frame: PhotonFrame) -> PhotonFrame:
    """The same photons as a frame that has just arrived: whether they are sorted is not known yet."""
    return PhotonEvents(frame.pixel, frame.toa) if isinstance(frame, PhotonEvents) else PhotonGates(frame.words)
