"""`histograms`: PhotonHistograms ⇄ Image, the photons in each bin of each pixel (msg_schemas/histograms.json)."""

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonHistograms, bins_of
from srt3d_ros.errors import require
from srt3d_ros.messages import cdr
from srt3d_ros.messages.packing import pack_image, unpack_image


def encode_cdr(histograms: PhotonHistograms, sensor: SensorModel, frame_id: str) -> bytes:
    """The serialised message of one frame, in the encoding of its counts' type.

    Raises:
        InvalidInput: the histograms do not fit the sensor, or a count is NaN or infinite.
    """
    histograms.check(sensor)
    return cdr.write_image(pack_image(cdr.Header(histograms.stamp_ns, frame_id), histograms.counts, "histograms"))


def decode_cdr(raw: bytes, sensor: SensorModel) -> tuple[cdr.Header, PhotonHistograms]:
    """The header and the counts of a serialised message, unchecked: a read-only view, or a copy of padded rows.

    Raises:
        InvalidInput: the message breaks the schema or has other pixels or bins than the sensor.
    """
    image = cdr.read_image(raw)
    require(image.height == sensor.rows, "height", image.height, f"the sensor's {sensor.rows} rows")
    require(image.width == sensor.cols, "width", image.width, f"the sensor's {sensor.cols} columns")
    counts = unpack_image(image, "histograms", bins_of(sensor))
    # Copies only padded rows and foreign byte order: a message may have 180 MB.
    counts = np.require(counts, counts.dtype.newbyteorder("="), ["C_CONTIGUOUS", "ALIGNED"])
    return image.header, PhotonHistograms(counts, image.header.stamp_ns)
