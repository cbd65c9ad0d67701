"""A recording's figures as text, for the terminal and the report."""

import numpy as np

_SPREADS = {"points": "points a frame", "photons": "photons a frame", "ppp": "photons per pixel"}


def format_summary(summary: dict) -> str:
    """The summary for a terminal."""
    return f"{summary['recording']}\n\n{align(rows(summary))}"


def align(lines: list[tuple[str, str]]) -> str:
    """(name, text) in two columns."""
    return "\n".join(f"  {name:<24}{text}" for name, text in lines)


def rows(summary: dict) -> list[tuple[str, str]]:
    """(name, figure with unit) of the figures that have data."""
    s = summary
    rate = f", {s['frame_rate_hz']:.3g} Hz" if s["frame_rate_hz"] else ""
    found = [("recorded", f"{s['started'].replace('T', ' ')}, {_duration(s['duration_s'])}, {_size(s['bytes'])}"),
             ("frames", f"{s['frames']:,}{rate}"), ("gaps", _gaps(s))]
    if s["clouds_not_recorded"]:
        found.append(("clouds not recorded", f"{s['clouds_not_recorded']:,}: thinned out, or the disk was slow"))
    if s["drops"] is not None:
        found.append(("drops", f"{s['drops']:,.0f} frames or messages, in all nodes"))
    found += [("latency" if stage == "total" else f"latency, {stage}",
               f"median {v['p50']:,.1f} ms, 95 % {v['p95']:,.1f} ms, worst {v['max']:,.1f} ms")
              for stage, v in s["latency_ms"].items()]
    found += [(title, f"median {_number(s[name]['median'])}, {_number(s[name]['min'])} … {_number(s[name]['max'])}")
              for name, title in _SPREADS.items() if s[name]]
    found.append(("size", f"{s['bytes_per_point']:.3g} bytes a point, all included"))
    if s["incomplete_series"]:
        lacks = ", ".join(f"{name} lacks {count}" for name, count in s["incomplete_series"].items())
        found.append(("incomplete series", lacks))
    if s["log"]:
        found.append(("log", log_counts(s)))
    return [*found, *_origin(s), (
        "frames to look at", f"typical {s['typical_frame']}, fewest points {s['fewest_points_frame']}, "
        f"most points {s['most_points_frame']}")]


def subtitle(summary: dict) -> str:
    """Date, duration, sensor and size, in a line."""
    sensor = summary.get("sensor", {})
    pixels = f", {sensor['rows']} × {sensor['cols']} pixels" if "rows" in sensor else ""
    started = summary["started"][:19].replace("T", " ")
    return f"Recorded {started} UTC, {_duration(summary['duration_s'])}{pixels}, {_size(summary['bytes'])}"


def headlines(summary: dict) -> list[dict]:
    """The most important figures: what, figure, and whether it is bad."""
    s, latency = summary, summary["latency_ms"].get("total")
    found = [("frames", f"{s['frames']:,}", False)]
    if s["frame_rate_hz"]:
        found.append(("frames a second", f"{s['frame_rate_hz']:.3g}", False))
    if latency:
        found += [("median latency", _milliseconds(latency["p50"]), False),
                  ("95 % are faster than", _milliseconds(latency["p95"]), False)]
    found += [(_SPREADS[name], _number(s[name]["median"]), False) for name in ("points", "photons") if s[name]]
    if s["drops"] is not None:
        found.append(("drops", f"{s['drops']:,.0f}", s["drops"] > 0))
    found.append(("gaps", f"{s['gap_count']:,}", s["gap_count"] > 0))
    return [{"what": what, "figure": figure, "bad": bad} for what, figure, bad in found]


def log_counts(summary: dict) -> str:
    """The number of log lines of each level."""
    return ", ".join(f"{count} {level}" for level, count in summary["log"].items())


def _origin(summary: dict) -> list[tuple[str, str]]:
    """Sensor, frequencies and version, as far as they are recorded."""
    found, sensor, run = [], summary.get("sensor", {}), summary.get("run", {})
    versions = summary.get("versions", run)         # early recordings have the version in `run`
    if sensor.keys() >= {"rows", "cols", "num_bins", "bin_width_s"}:
        found.append(("sensor", f"{sensor['rows']} × {sensor['cols']} pixels, {sensor['num_bins']:,} bins of "
                                f"{sensor['bin_width_s'] * 1e12:.4g} ps, {sensor.get('projection', 'pinhole')}"))
    if "frequencies" in run:
        frequencies = np.atleast_1d(run["frequencies"]).tolist()
        found.append(("frequencies", f"{len(frequencies)}: {' '.join(str(k) for k in frequencies)}"))
    if "srt3d_ros" in versions:
        revision, changed, _ = versions.get("git_revision", "").partition("+")
        revision = f", revision {revision[:12]}{' and changes' * bool(changed)}" if revision else ""
        found.append(("srt3d_ros", f"{versions['srt3d_ros']}{revision}"))
    return found


def _gaps(summary: dict) -> str:
    if not summary["gap_count"]:
        return "none"
    longest = max(summary["gaps"], key=lambda gap: gap["seconds"])
    return (f"{summary['gap_count']}, about {summary['missing_frames']} frames; the longest {longest['seconds']:.3g} s "
            f"after frame {longest['after_frame']}")


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 1000 or value == round(value) else f"{value:.3g}"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{seconds:.3g} s"


def _size(number: int) -> str:
    return f"{number / 1e6:,.1f} MB" if number < 1e9 else f"{number / 1e9:,.2f} GB"


def _milliseconds(value: float) -> str:
    return f"{value:.3g} ms" if value < 1000 else f"{value / 1e3:.3g} s"
