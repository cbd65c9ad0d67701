"""What is timed: the reconstruction and the sketching of a frame, each from the host's memory and back into it."""

from srt3d_ros.benchmark.timing import Work
from srt3d_ros.core.methods import Method
from srt3d_ros.core.photons import PhotonEvents, PhotonFrame, PhotonGates
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketching import Sketcher
from srt3d_ros.errors import InvalidInput


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
    """The sketch of a frame, in the host's memory."""
    sketcher = Sketcher(sensor, frequencies, device=device)
    sketcher.add(photons)
    return sketcher.sketch().on_host()


def reconstruction(reconstructor, frame: PhotonEvents | Sketch, title: str, facts: dict) -> Work:
    """The reconstruction of a frame, where the reconstructor computes."""
    return Work(lambda: reconstructor(frame), title, facts | {"device": reconstructor.device})


def sketching(sketcher: Sketcher, frame: PhotonFrame, title: str, facts: dict) -> Work:
    """The sketching of a frame that has just arrived: whether its photons are sorted is not known yet."""
    def fresh() -> PhotonFrame:
        return PhotonEvents(frame.pixel, frame.toa) if isinstance(frame, PhotonEvents) else PhotonGates(frame.words)
    return Work(lambda: sketcher.add(fresh()), title, facts)
