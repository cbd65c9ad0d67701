"""The topics on which photons come, each with its codec."""

from srt3d_ros.messages import gates, histograms, photons

CODECS = {"photons": photons, "gates": gates, "histograms": histograms}
