"""`photons`: PhotonEvents ⇄ PointCloud2, one point per photon (msg_schemas/photons.json)."""

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.errors import require
from srt3d_ros.messages import cdr
from srt3d_ros.messages.packing import pack_cloud, unpack_cloud
from srt3d_ros.messages.schema_files import cloud_layouts


def encode_cdr(events: PhotonEvents, sensor: SensorModel, frame_id: str) -> bytes:
    """The serialised message of one frame, in the layout of the events' ToA (uint16 or float32).

    Raises:
        InvalidInput: a photon lies outside the sensor.
    """
    events.check(sensor)
    points = np.zeros(events.photons, cloud_layouts("photons")[events.toa.dtype.name])
    points["row"], points["col"] = np.divmod(events.pixel, np.uint32(sensor.cols))
    points["toa"] = events.toa
    return cdr.write_cloud(pack_cloud(cdr.Header(events.stamp_ns, frame_id), points))


def decode_cdr(raw: bytes, sensor: SensorModel) -> tuple[cdr.Header, PhotonEvents]:
    """The header and the photons of a serialised message, in its order and with its type of ToA, which is unchecked.

    The cloud may be organised (rows of points, joined here) and padded.

    Raises:
        InvalidInput: the message breaks the schema, or a photon lies outside the sensor's pixels.
    """
    cloud = cdr.read_cloud(raw)
    points = unpack_cloud(cloud, list(cloud_layouts("photons").values())).reshape(-1)
    row, col = points["row"].astype(np.uint32), points["col"].astype(np.uint32)
    for name, index, count in (("row", row, sensor.rows), ("col", col, sensor.cols)):
        largest = int(index.max(initial=0))
        require(largest < count, name, largest, f"an index below the sensor's {count}")
    toa = points["toa"]
    pixel, toa = row * np.uint32(sensor.cols) + col, toa.astype(toa.dtype.newbyteorder("="))
    return cloud.header, PhotonEvents(pixel, toa, cloud.header.stamp_ns)
