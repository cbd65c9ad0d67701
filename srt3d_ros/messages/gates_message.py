"""`gates`: PhotonGates ⇄ Image, the ToA words of G laser cycles (msg_schemas/gates.json)."""

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonGates, gate_words
from srt3d_ros.errors import require
from srt3d_ros.messages import cdr
from srt3d_ros.messages.packing import pack_image, unpack_image


def encode_cdr(gates: PhotonGates, sensor: SensorModel, frame_id: str) -> bytes:
    """The serialised message of G cycles.

    Raises:
        InvalidInput: the words do not fit the sensor, or the sensor has no `gates`.
    """
    gates.check(sensor)
    return cdr.write_image(pack_image(cdr.Header(gates.stamp_ns, frame_id), gates.words.reshape(-1, sensor.cols, 1),
                                      "gates"))


def decode_cdr(raw: bytes, sensor: SensorModel) -> tuple[cdr.Header, PhotonGates]:
    """The header and the words of a serialised message, unchecked: a read-only view, or a copy of padded rows.

    Raises:
        InvalidInput: the message breaks the schema or has other pixels than the sensor, or the sensor has no `gates`.
    """
    image = cdr.read_image(raw)
    form = gate_words(sensor)
    require(image.width == sensor.cols, "width", image.width, f"the sensor's {sensor.cols} columns")
    require(image.height % sensor.rows == 0, "height", image.height, f"a multiple of the sensor's {sensor.rows} rows")
    # Copies only padded rows and foreign byte order: a copy of 300 MB/s takes a tenth of a core.
    words = np.require(unpack_image(image, "gates"), np.uint16, ["C_CONTIGUOUS", "ALIGNED"])
    photons = int(np.count_nonzero(words != form.no_detection))
    return image.header, PhotonGates(words.reshape(-1, sensor.rows, sensor.cols), image.header.stamp_ns, photons)
