"""Sketches over a slow or lossy link between two machines: how many arrive, and how late (needs root).

The machines are network namespaces (tools/machines.py; needs iproute2). `limits` sends sketches of all sizes over 100
Mbit/s and 1 Gbit/s; `loss` sends them over 100 Mbit/s with lost packets, with each Fast DDS profile of the sketcher.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.frames import save_frame
from tools.machines import NETWORK_PROFILE, ROBOT, SENSOR, Arrival, Link, Machines, why_not

OWN, PROFILES = "Fast DDS's own", ("Fast DDS's own", "default", "network")      # of the sketcher; docs/deployment.md
OWN_PROFILE = """<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><profiles>
<participant profile_name="own"/></profiles></dds>"""
SMALL, LARGE = 141, 512
SILENCE_S = 2.0         # without a message: no more will come
SIZES = (               # rows and columns, layout, m, frames per second
    (SMALL, "int16", 5, 10.0), (SMALL, "int16", 10, 10.0), (SMALL, "int16", 5, 30.0), (SMALL, "float32", 10, 10.0),
    (LARGE, "int16", 5, 10.0), (LARGE, "float32", 10, 10.0))
PARTS = {               # options of `sketches`, a line each
    "limits": [{"mbit": 100, "case": SIZES[0], "reader": "reconstructor"},
               *({"mbit": mbit, "case": case, "profile": profile} for mbit, profile in (
                   (100, "default"), (1000, "default"), (1000, "network")) for case in SIZES)],
    "loss": [{"mbit": 100, "case": SIZES[0], "loss": loss, "profile": profile}
             for loss in (0, 0.001, 0.01) for profile in PROFILES],
}


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("parts", nargs="*", default=[*PARTS], metavar="part", help=f"any of {', '.join(PARTS)}")
    parser.add_argument("--seconds", type=float, default=10.0, help="playing time of each line (%(default)g)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    if reason := why_not():
        sys.exit(f"cannot make a link between two machines: {reason}")
    with tempfile.TemporaryDirectory(prefix="srt3d-two-machines-") as folder:
        for part in args.parts:
            for options in PARTS[part]:
                yield {"part": part, **sketches(Path(folder), args.seconds, **options)}


def sketches(folder: Path, seconds: float, mbit: float, case: tuple, loss: float = 0, profile: str = "default",
             reader: str = "") -> dict:
    """Send sketches over a link, to the node `reader` or, without one, to a subscriber that notes their arrival."""
    side, layout, size, rate_hz = case
    own, sent = folder / "own.xml", round(rate_hz * seconds)
    own.write_text(OWN_PROFILE)
    with Link(mbit) as link, Machines(link, folder) as machines:
        if loss:
            link.lose(loss)
        if reader:
            machines.start_on(ROBOT, reader)
        watch = machines.watch("points" if reader else "sketch", str(own) if profile == OWN else None)
        machines.start_on(SENSOR, "sketcher", {OWN: str(own), "network": NETWORK_PROFILE}.get(profile),
                          layout=layout, sketch_size=size)
        for name in filter(None, ("sketcher", reader)):
            machines.wait(lambda: name in watch.reports, name)
        before = link.wire_bytes()
        machines.start_on(SENSOR, "player", input=save_frame(folder, side), rate_hz=rate_hz, frames=sent)
        machines.wait(lambda: watch.total("player", "frames_out") >= sent, "the player", 10 * seconds + SILENCE_S)
        arrived = -1
        while arrived < len(watch.arrivals):
            arrived = len(watch.arrivals)
            time.sleep(SILENCE_S)
        wire = link.wire_bytes() - before
        first_ns, last_ns = (watch.arrivals[0].stamp_ns, watch.arrivals[-1].received_ns) if arrived else (0, np.inf)
        return {"mbit": mbit, "loss": loss, "profile": profile, "side": side, "layout": layout, "m": size,
                "rate_hz": rate_hz, "reader": reader or "note", "frames": sent, "arrived": arrived,
                "latency_ms": percentiles(watch.arrivals),
                "dropped_by_sketcher": watch.total("sketcher", "dropped"),
                "lost_before_sketcher": watch.total("sketcher", "message_lost"),
                "predicted_mbit": round(
                    side**2 * (4 + size * {"int16": 4, "float32": 8}[layout]) * 8e-6 * rate_hz, 1),
                "wire_mbit": round(wire * 8e-6 / ((last_ns - first_ns) * 1e-9 + 1 / rate_hz), 1),
                "wire_bytes_per_frame": round(wire / max(arrived, 1))}


def percentiles(arrivals: Sequence[Arrival]) -> dict[str, float]:
    """Median, 95th percentile and maximum of the latency, ms."""
    values = np.percentile([arrival.latency_ms for arrival in arrivals] or [np.nan], [50, 95, 100])
    return dict(zip(("p50", "p95", "max"), np.round(values, 1).tolist()))
