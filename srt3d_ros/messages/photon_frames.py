"""The codecs of photons: PhotonEvents ⇄ PointCloud2, PhotonGates and PhotonHistograms ⇄ Image."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonFrame, PhotonGates, PhotonHistograms
from srt3d_ros.errors import require
from srt3d_ros.messages import cdr
from srt3d_ros.messages.packing import encode_cloud, encode_image, unpack_cloud, unpack_image
from srt3d_ros.messages.schema_files import cloud_layouts


class Codec(NamedTuple):
    """How a topic of photons is written and read.

    Args:
        encode_cdr: gives the serialised message of a frame, for a sensor and its frame in tf; InvalidInput if the frame
            does not fit the sensor.
        decode_cdr: gives the header and the frame of a serialised message; InvalidInput if the message breaks the
            schema, or has other pixels or bins than the sensor. ToA and counts are unchecked, and may be read-only
            views.
    """

    encode_cdr: Callable[[Any, SensorModel, str], bytes]
    decode_cdr: Callable[[bytes, SensorModel], tuple[cdr.Header, PhotonFrame]]


def _encode_events(events: PhotonEvents, sensor: SensorModel, frame_id: str) -> bytes:
    """One point per photon, in the layout of the events' ToA, uint16 or float32 (msg_schemas/photons.json)."""
    events.check(sensor)
    points = np.zeros(events.photons, cloud_layouts("photons")[events.toa.dtype.name])
    points["row"], points["col"] = np.divmod(events.pixel, np.uint32(sensor.cols))
    points["toa"] = events.toa
    return encode_cloud(points, events.stamp_ns, frame_id)


def _decode_events(raw: bytes, sensor: SensorModel) -> tuple[cdr.Header, PhotonEvents]:
    """The photons, in the order and with the type of ToA of the message, whose cloud may be organised and padded."""
    cloud = cdr.CloudMessage.read(raw)
    points = unpack_cloud(cloud, list(cloud_layouts("photons").values())).reshape(-1)
    row, col = points["row"].astype(np.uint32), points["col"].astype(np.uint32)
    for name, index, count in (("row", row, sensor.rows), ("col", col, sensor.cols)):
        largest = int(index.max(initial=0))
        require(largest < count, name, largest, f"an index below the sensor's {count}")
    toa = points["toa"]
    pixel, toa = row * np.uint32(sensor.cols) + col, toa.astype(toa.dtype.newbyteorder("="))
    return cloud.header, PhotonEvents(pixel, toa, cloud.header.stamp_ns)


def _encode_gates(gates: PhotonGates, sensor: SensorModel, frame_id: str) -> bytes:
    """The ToA words of G laser cycles, below each other (msg_schemas/gates.json)."""
    gates.check(sensor)
    return encode_image(gates.words.reshape(-1, sensor.cols, 1), "gates", gates.stamp_ns, frame_id)


def _decode_gates(raw: bytes, sensor: SensorModel) -> tuple[cdr.Header, PhotonGates]:
    """The words: a read-only view, or a copy of padded rows; InvalidInput also if the sensor has no `gates`."""
    image = cdr.Image.read(raw)
    form = sensor.gate_words
    require(image.width == sensor.cols, "width", image.width, f"the sensor's {sensor.cols} columns")
    require(image.height % sensor.rows == 0, "height", image.height, f"a multiple of the sensor's {sensor.rows} rows")
    # Copies only padded rows and foreign byte order: a copy of 300 MB/s takes a tenth of a core.
    words = np.require(unpack_image(image, "gates"), np.uint16, ["C_CONTIGUOUS", "ALIGNED"])
    photons = int(np.count_nonzero(words != form.no_detection))
    return image.header, PhotonGates(words.reshape(-1, sensor.rows, sensor.cols), image.header.stamp_ns, photons)


def _encode_histograms(histograms: PhotonHistograms, sensor: SensorModel, frame_id: str) -> bytes:
    """The counts per pixel and bin, in the encoding of their type (msg_schemas/histograms.json)."""
    histograms.check(sensor)
    return encode_image(histograms.counts, "histograms", histograms.stamp_ns, frame_id)


def _decode_histograms(raw: bytes, sensor: SensorModel) -> tuple[cdr.Header, PhotonHistograms]:
    """The counts: a read-only view, or a copy of padded rows."""
    image = cdr.Image.read(raw)
    require(image.height == sensor.rows, "height", image.height, f"the sensor's {sensor.rows} rows")
    require(image.width == sensor.cols, "width", image.width, f"the sensor's {sensor.cols} columns")
    counts = unpack_image(image, "histograms", sensor.histogram_size)
    # Copies only padded rows and foreign byte order: a message may have 180 MB.
    counts = np.require(counts, counts.dtype.newbyteorder("="), ["C_CONTIGUOUS", "ALIGNED"])
    return image.header, PhotonHistograms(counts, image.header.stamp_ns)


PHOTONS = Codec(_encode_events, _decode_events)
GATES = Codec(_encode_gates, _decode_gates)
HISTOGRAMS = Codec(_encode_histograms, _decode_histograms)
CODECS = {"photons": PHOTONS, "gates": GATES, "histograms": HISTOGRAMS}     # by topic
