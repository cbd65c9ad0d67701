"""CODECS: the module for each topic of photons."""

from srt3d_ros.messages import gates_message, histograms_message, photons_message

CODECS = {"photons": photons_message, "gates": gates_message, "histograms": histograms_message}
