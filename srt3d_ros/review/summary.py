"""Compute the figures of a recording, for JSON, the terminal and the report."""

from typing import Any

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.messages import sensor_message
from srt3d_ros.pictures.units import duration_text, number_text, size_text
from srt3d_ros.recording import entities
from srt3d_ros.review.recorded import Recorded

_DIGITS = 3
_SPREADS = {"points": "points a frame", "photons": "photons a frame", "ppp": "photons per pixel"}


def summarise(recorded: Recorded) -> dict:
    """All figures of a recording; None without data.

    frame_rate_hz is the mean, period_ms the median. The properties follow, the sensor without its arrays.
    """
    index, seconds, gaps, period_s = recorded.index, recorded.seconds, recorded.gaps, recorded.period_s
    frames, duration, steps = len(index), float(seconds[-1]), np.diff(seconds)
    typical, fewest, most = notable_frames(recorded)
    spread = {"points": index.points} | {name: recorded.series[name].values for name in ("photons", "ppp")
                                         if name in recorded.series}
    summary = {
        "recording": str(recorded.path), "started": iso_time(index.stamp_ns[0]),
        "frames": frames, "duration_s": _rounded(duration),
        "frame_rate_hz": _rounded((frames - 1) / duration) if duration > 0 else None,
        "period_ms": _rounded(period_s * 1e3) if period_s else None,
        "gaps": len(gaps), "missing_frames": sum(max(round(step / period_s) - 1, 1) for step in steps[gaps].tolist()),
        "longest_gap": {"seconds": _rounded(steps[gaps[0]]), "at_s": _rounded(seconds[gaps[0]]),
                        "after_frame": int(index.frame_index[gaps[0]])} if len(gaps) else None,
        "latency_ms": {stage: _percentiles(series.values, p50=50, p95=95, max=100)
                       for stage, series in recorded.latencies().items()},
        **{name: _percentiles(spread.get(name, np.empty(0)), median=50, min=0, max=100) for name in _SPREADS},
        "bytes": recorded.path.stat().st_size,
        "typical_frame": int(index.frame_index[typical]), "fewest_points_frame": int(index.frame_index[fewest]),
        "most_points_frame": int(index.frame_index[most]),
    }
    properties = recorded.properties | {entities.SENSOR_PROPERTY: _facts(recorded.sensor)}
    return summary | {name: {key: _plain(value) for key, value in facts.items()}
                      for name, facts in properties.items() if name not in summary}


def notable_frames(recorded: Recorded) -> tuple[int, int, int]:
    """Positions in the index of the clouds with the median number of points, the fewest and the most.

    Among equal numbers, the order is that of time.
    """
    order = np.argsort(recorded.index.points, kind="stable").tolist()
    return order[len(order) // 2], order[0], order[-1]


def _percentiles(values: np.ndarray, **wanted: float) -> dict[str, float] | None:
    """Percentiles of the finite values, by name; None without any."""
    values = values[np.isfinite(values)]
    return dict(zip(wanted, map(_rounded, np.percentile(values, [*wanted.values()])))) if len(values) else None


def iso_time(stamp_ns: int) -> str:
    """A stamp as UTC, 2026-11-21T18:18:50.123Z."""
    return str(np.datetime_as_string(np.datetime64(int(stamp_ns), "ns"), unit="ms", timezone="UTC"))


def format_summary(summary: dict) -> str:
    """The summary for a terminal."""
    return f"{summary['recording']}\n\n{align(rows(summary))}"


def align(lines: list[tuple[str, str]]) -> str:
    """Lines of (name, text) in two columns."""
    return "\n".join(f"  {name:<26}{text}" for name, text in lines)


def rows(summary: dict) -> list[tuple[str, str]]:
    """(name, figure with unit) of each figure with data."""
    s = summary
    rate = f", {s['frame_rate_hz']:.3g} Hz" if s["frame_rate_hz"] else ""
    when = s["started"].replace("T", " ")
    found = [("recorded", f"{when}, {duration_text(s['duration_s'])}, {size_text(s['bytes'])}"),
             ("frames", f"{s['frames']:,}{rate}"), ("gaps", _gap_text(s))]
    found += [("latency" if stage == "total" else f"latency, {stage}",
               f"median {v['p50']:,.1f} ms, 95 % {v['p95']:,.1f} ms, worst {v['max']:,.1f} ms")
              for stage, v in s["latency_ms"].items()]
    for name, title in _SPREADS.items():
        if s[name]:
            median, least, most = (number_text(s[name][key]) for key in ("median", "min", "max"))
            found.append((title, f"median {median}, {least} … {most}"))
    sensor = s["sensor"]
    return [*found, ("sensor", f"{sensor['rows']} × {sensor['cols']} pixels, {sensor['num_bins']:,} bins of "
                               f"{sensor['bin_width_s'] * 1e12:.4g} ps, {sensor['kind']}"),
            ("frames to look at", f"typical {s['typical_frame']}, fewest points {s['fewest_points_frame']}, "
                                  f"most points {s['most_points_frame']}")]


def _rounded(value: float) -> float:
    return round(float(value), _DIGITS)


def _facts(sensor: SensorModel) -> dict:
    """The sensor's description without arrays, with the projection's entries as its own."""
    content = sensor_message.to_object(sensor)
    content |= content["projection"]
    return {name: value for name, value in content.items() if not isinstance(value, dict)}


def _plain(value: Any) -> Any:
    """A property for JSON; NaN and Inf as strings."""
    value = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
    if isinstance(value, list):
        return [_plain(one) for one in value]
    finite = not isinstance(value, float) or np.isfinite(value)
    return value if isinstance(value, str | int | float | bool | None) and finite else str(value)


def _gap_text(summary: dict) -> str:
    if not summary["gaps"]:
        return "none"
    longest = summary["longest_gap"]
    return (f"{summary['gaps']:,}, about {summary['missing_frames']:,} frames; the longest "
            f"{longest['seconds']:.3g} s, at {longest['at_s']:.1f} s, after frame {longest['after_frame']}")
