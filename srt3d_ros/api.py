"""The Python library, `import srt3d_ros`: from photon files, arrays and sketches to point clouds."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Unpack

from srt3d_ros import datasets
from srt3d_ros.cloud import Cloud, as_noun
from srt3d_ros.core.keys import written_out
from srt3d_ros.core.method.background import BACKGROUNDS
from srt3d_ros.core.method.thresholds import DEFAULT_FALSE_ALARM_RATE
from srt3d_ros.core.methods import DEFAULT_METHOD, MethodOptions
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.signs_of_life import FreeSpaceStream
from srt3d_ros.core.sketching.design import SketchOptions
from srt3d_ros.core.sketching.gate import OFF
from srt3d_ros.core.sketching.photon_frame import PhotonFrame
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.datasets.arrays import from_frame, with_options
from srt3d_ros.datasets.options import SensorOptions, gathered
from srt3d_ros.datasets.reading import IN_MEMORY, Reading, Said
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.photons import Photons
from srt3d_ros.reconstruction import Reconstructor
from srt3d_ros.sketch import Sketch

__all__ = ["Cloud", "FreeSpaceStream", "InvalidInput", "Photons", "Reconstructor", "Sensor", "Sketch", "from_counts",
           "from_events", "read", "reconstruct"]

Sensor = SensorModel
from_events, from_counts = Photons.from_events, Photons.from_counts


@written_out()
def read(source: Any, frame: int = 0, *, photons_topic: str = "", sensor: SensorModel | None = None,
         **options: Unpack[SensorOptions]) -> Photons | Sketch | Cloud:
    """The photons of a file, bag, log or array, with their sensor and the truth, if known; or what `save` wrote.

    Args:
        source: the path of a file (.npz, .mat, .h5, .ptu, …: docs/photon-file.md), of a log of
            histograms or of a bag (docs/bags.md); "simulator", for its moving head; counts [rows, cols, bins]; or
            Photons or a Sketch.
        frame: number of the message in a bag, or of the frame in a log, from 0.
        photons_topic: topic of the photons or sketches, if a bag has several.
        sensor: replaces the source's sensor.
        options: what the source lacks or has wrong: num_bins, bin_width_s, irf, irf_ref, fov_deg, gate (first and last
            bin, both kept), rows, cols, axes ("bins,rows,cols") of counts, columns ("y,x,t", the file's arrays of row,
            column and ToA), …. They win over `sensor` and the source; a note says so.

    Returns:
        Photons, which stay in the file if they are too many to keep; the Sketch of a bag of sketches; or the Photons,
        Sketch or Cloud that `save` wrote as .npz.

    Raises:
        InvalidInput: the file or an option cannot be used.
    """
    if isinstance(source, str | Path):
        return noun_of(datasets.read(source, frame, photons_topic, sensor=sensor, **options))
    for name, value in (("frame", frame), ("photons_topic", photons_topic)):
        require(not value, name, problem=f"{name} {value}: only a bag or a log has one.")
    if isinstance(source, PhaseSums):
        source = Reading(source.sensor, source, None, IN_MEMORY, getattr(source, "notes", ()))
    if isinstance(source, Reading):
        return noun_of(with_options(source, gathered(options, sensor)))
    if isinstance(source, PhotonFrame):
        return noun_of(from_frame(source, gathered(options, sensor), Said()))
    paths = isinstance(source, list | tuple) and all(isinstance(one, str | Path) for one in source)
    require((hasattr(source, "__array__") or isinstance(source, list)) and not paths, "source",
            f"{type(source).__name__} of {len(source)} paths" if paths else type(source).__name__,
            "one path (read several in a loop), an array of counts, Photons or a Sketch")
    return Photons.from_counts(source, sensor=sensor, **options)


def noun_of(reading: Reading) -> Photons | Sketch | Cloud:
    """What a reading holds, with its notes, in the class that reconstructs and saves it."""
    if isinstance(reading.frame, PhaseSums):
        return as_noun(Sketch, reading.frame, notes=reading.notes)
    if isinstance(reading.frame, PointCloud):
        return as_noun(Cloud, reading.frame, notes=reading.notes)
    return Photons(reading.sensor, reading.frame, reading.reference_depth_bins, reading.name, reading.notes)


@written_out(SketchOptions, MethodOptions)
def reconstruct(source: Any, *, sensor: SensorModel | None = None, method: str = DEFAULT_METHOD,
                sketch_size: int | None = None, frequencies: str | Sequence[int] | None = None,
                gate: str | tuple[int, int] = OFF, surfaces: int = 1, device: str = "auto",
                false_alarm_rate: float = DEFAULT_FALSE_ALARM_RATE, background: str = BACKGROUNDS[0],
                **options: Unpack[SensorOptions]) -> Cloud:
    """The point cloud of photons or of their sketch.

    Args:
        source, sensor: see `read`, also for the arguments that describe the sensor.

    Raises:
        InvalidInput: an argument is missing or cannot be used.
    """
    seen = source if isinstance(source, Cloud) else read(source, sensor=sensor, **options)
    require(not isinstance(seen, Cloud), "source", problem="A cloud cannot be reconstructed: give photons or a sketch.")
    own: MethodOptions = {"method": method, "surfaces": surfaces, "device": device,
                          "false_alarm_rate": false_alarm_rate, "background": background}
    if isinstance(seen, Photons):
        return seen.reconstruct(sketch_size=sketch_size, frequencies=frequencies, gate=gate, **own)
    made_with = {"sketch_size": sketch_size, "frequencies": frequencies, "gate": None if gate == OFF else gate}
    for name, value in made_with.items():
        require(value is None, name, problem=f"{name} {value}: the sketch is already made; give it to `sketch`.")
    return seen.reconstruct(**own)
