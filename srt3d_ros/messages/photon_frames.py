"""The topics on which photons come, each with its codec, and photons in the form that a topic carries."""

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photons import PhotonEvents, PhotonFrame, PhotonGates, PhotonHistograms
from srt3d_ros.messages import gates, histograms, photons

CODECS = {"photons": photons, "gates": gates, "histograms": histograms}
FORMS = {"photons": PhotonEvents, "gates": PhotonGates, "histograms": PhotonHistograms}


def encode_cdr(frame: PhotonFrame, topic: str, sensor: SensorModel) -> bytes:
    """The serialised message of a frame in the form of a topic; InvalidInput if the topic cannot carry it."""
    form = FORMS[topic]
    if not isinstance(frame, form):
        events = frame if isinstance(frame, PhotonEvents) else frame.to_events(sensor)
        frame = events if form is PhotonEvents else form.from_events(events, sensor)
    return CODECS[topic].encode_cdr(frame, sensor, sensor.frame_id)
