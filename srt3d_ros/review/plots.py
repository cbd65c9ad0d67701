"""Which plots a recording's report shows."""

import numpy as np

from srt3d_ros.pictures.svg import draw_histogram, draw_lines
from srt3d_ros.recording.reader import Series
from srt3d_ros.review.recorded import Recorded
from srt3d_ros.review.summary import find_gaps

TIME = "seconds since the first cloud"
TOTAL = "end to end"


def draw_plots(recorded: Recorded) -> list[tuple[str, str]]:
    """(title, SVG) of the plots for which the recording holds values; gaps are shaded."""
    latencies = {TOTAL if stage == "total" else stage: series for stage, series in recorded.latencies().items()}
    plots = [("Latency", "latency, ms", latencies),
             ("Points a frame", "points", {"points": Series(recorded.index.stamp_ns, recorded.at_clouds("points"))}),
             ("Photons a frame", "photons", _chosen(recorded, "photons")),
             ("Frame rate", "frames a second", {"rate": _rate(recorded)}),
             ("Drops so far, all nodes", "frames or messages", _chosen(recorded, "drops"))]
    spans = [(gap["at_s"], gap["at_s"] + gap["seconds"]) for gap in find_gaps(recorded)[0]]
    drawn = [(title, draw_lines({name: (recorded.since_first(s.stamp_ns), s.values) for name, s in lines.items()},
                                TIME, label, spans)) for title, label, lines in plots if lines]
    if latencies:
        name = TOTAL if TOTAL in latencies else next(iter(latencies))
        drawn.insert(1, ("How often each latency", draw_histogram(latencies[name].values, f"latency {name}, ms",
                                                                  "frames")))
    return drawn


def _chosen(recorded: Recorded, name: str) -> dict[str, Series]:
    return {name: recorded.series[name]} if name in recorded.series else {}


def _rate(recorded: Recorded) -> Series:
    """Clouds a second, as recorded or else from their stamps."""
    if "frame_rate_hz" in recorded.series:
        return recorded.series["frame_rate_hz"]
    stamps = recorded.index.stamp_ns
    with np.errstate(divide="ignore"):
        return Series(stamps[1:], 1e9 / np.diff(stamps))
