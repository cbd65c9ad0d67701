"""The topics on which photons come, each with its codec, and photons in the form that a topic carries."""

from srt3d_ros.core.photons import PhotonEvents, PhotonFrame, PhotonGates, PhotonHistograms
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.messages import gates, histograms, photons

CODECS = {"photons": photons, "gates": gates, "histograms": histograms}
FORMS = {"gates": PhotonGates, "histograms": PhotonHistograms}


def as_sent(frame: PhotonFrame, topic: str, sensor: SensorModel) -> PhotonFrame:
    """The same photons in the form that a topic carries; InvalidInput if they have none."""
    if topic == "histograms" and isinstance(frame, PhotonHistograms):       # negative counts are no events
        return frame
    events = frame if isinstance(frame, PhotonEvents) else frame.to_events(sensor)
    return FORMS[topic].from_events(events, sensor) if topic in FORMS else events


def encode_cdr(frame: PhotonFrame, topic: str, sensor: SensorModel) -> bytes:
    """The serialised message of a frame for a topic; InvalidInput if the topic cannot carry it."""
    return CODECS[topic].encode_cdr(as_sent(frame, topic, sensor), sensor, sensor.frame_id)
