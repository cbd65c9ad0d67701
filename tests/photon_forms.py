"""Convert photon events to the other forms in which sensors send photons."""

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonGates, PhotonHistograms


def as_gates(events: PhotonEvents, sensor: SensorModel) -> PhotonGates:
    """The same photons as gates: the i-th photon of a pixel falls into cycle i. A float ToA becomes its bin."""
    order = np.argsort(events.pixel, kind="stable")
    counts = np.bincount(events.pixel, minlength=sensor.pixels)
    cycle = np.arange(events.photons) - np.repeat(np.cumsum(counts) - counts, counts)
    words = np.full((max(int(counts.max()), 1), sensor.pixels), sensor.gates.no_detection, np.uint16)
    words[cycle, events.pixel[order]] = sensor.toa_bins(events.toa[order]) + np.uint16(sensor.gates.first_word)
    return PhotonGates(words.reshape(-1, sensor.rows, sensor.cols), events.stamp_ns)


def as_histograms(events: PhotonEvents, sensor: SensorModel) -> PhotonHistograms:
    """The same photons counted in the sensor's T bins."""
    at = events.pixel.astype(np.int64) * sensor.num_bins + sensor.toa_bins(events.toa)
    counts = np.bincount(at, minlength=sensor.pixels * sensor.num_bins).astype(np.uint16)
    return PhotonHistograms(counts.reshape(sensor.rows, sensor.cols, -1), events.stamp_ns)
