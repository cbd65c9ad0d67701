"""Sensors that send histograms: an adapter each, from its own log or stream to SensorModel and PhotonHistograms."""

from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from srt3d_ros import datasets
from srt3d_ros.datasets.photons import Photons, gather_options
from srt3d_ros.datasets.stream import PhotonStream
from srt3d_ros.devices import as_dt1, tmf882x, tmf8829, vl53l8ch
from srt3d_ros.devices.reading import Reading, head
from srt3d_ros.errors import require

LOG_SUFFIXES = (".json", ".gz", ".csv", ".txt", ".log", as_dt1.SUFFIX)


class Device(NamedTuple):
    """An adapter.

    Args:
        sensor, reads: what it is and what is read, in words.
        read: the frames of a log.
        recognises: whether a text log begins like one of its own; None where its suffix tells.
        decode: (message, stamp_ns) → a frame of its publisher, or None; None if it has no publisher.
    """

    sensor: str
    reads: str
    read: Callable[[Path], Iterator[Reading]]
    recognises: Callable[[str], bool] | None = None
    decode: Callable[[bytes, int], Reading | None] | None = None


DEVICES = {
    "tmf8829": Device(tmf8829.SENSOR, tmf8829.READS, tmf8829.read, tmf8829.recognises, tmf8829.decode),
    "tmf882x": Device(tmf882x.SENSOR, tmf882x.READS, tmf882x.read, tmf882x.recognises),
    "vl53l8ch": Device(vl53l8ch.SENSOR, vl53l8ch.READS, vl53l8ch.read, vl53l8ch.recognises),
    "as_dt1": Device(as_dt1.SENSOR, as_dt1.READS, as_dt1.read),
}


def of_log(path: str | Path) -> Device | None:
    """The device whose log a file is, None if it is none; InvalidInput if it cannot be read."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in LOG_SUFFIXES or not path.is_file():
        return None
    if suffix == as_dt1.SUFFIX:
        return DEVICES["as_dt1"]
    beginning = head(path)
    return next((device for device in DEVICES.values() if device.recognises and device.recognises(beginning)), None)


def frames(path: str | Path, device: Device, **overrides) -> Iterator[Photons]:
    """The frames of a device's log, with a sidecar's and these options in place of what it says."""
    path = Path(path)
    options = gather_options(path.absolute(), overrides)
    for sensor, frame, notes in device.read(path):
        yield Photons(sensor, frame, None, path.stem, notes).with_options(options)


def open_stream(path: str | Path, frame: int = 0, photons_topic: str = "", guess_irf: bool = False, **overrides
                ) -> Photons | PhotonStream:
    """What `datasets.open_stream` opens, and frame `frame` of a device's log."""
    device = of_log(path)
    if device is None:
        return datasets.open_stream(path, frame, photons_topic, guess_irf, **overrides)
    require(frame >= 0, "frame", frame, "0 or more")
    found = next(islice(frames(path, device, **overrides), frame, None), None)
    require(found is not None, "frame", frame, f"less: {Path(path).name} ends before")
    return found
