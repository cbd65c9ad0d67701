"""Sketcher and reconstructor on two machines joined by 100 Mbit/s or 1 Gbit/s: what passes, how late, at what loss.

The machines are network namespaces (link.py): needs root and iproute2. After its lines each part prints a table in
Markdown; docs/deployment.md has them.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks.link import ROBOT, SENSOR, Link, why_not
from benchmarks.machines import NETWORK_PROFILE, Machines, Watch
from benchmarks.pipeline import percentiles
from srt3d_ros.benchmark import frames
from srt3d_ros.benchmark.timing import status_bytes
from srt3d_ros.datasets import npz
from srt3d_ros.evaluation.results import aligned

OWN, PROFILES = "Fast DDS's own", ("Fast DDS's own", "default", "network")      # of the sketcher; docs/deployment.md
OWN_PROFILE = """<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><profiles>
<participant profile_name="own"/></profiles></dds>"""
SMALL, LARGE = 141, 512
RAW_PPP, RAW_HZ = 1000, 10.0
RAW_BYTES = 6           # a photon, of the layout uint16
SILENCE_S = 2.0         # after the last frame: no more will come
OUTAGES_S = (5.0, 30.0)
LIMITS = (              # pixels of a side, layout, m, frames a second
    (SMALL, "int16", 5, 10.0), (SMALL, "int16", 10, 10.0), (SMALL, "int16", 5, 30.0), (SMALL, "float32", 10, 10.0),
    (LARGE, "int16", 5, 10.0), (LARGE, "float32", 10, 10.0))
SKETCHER = {"layout": "int16", "sketch_size": 5}
COUNTS = ("message", "frames_in", "frames_out", "dropped", "message_lost", "latency_p50_ms")


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("parts", nargs="*", default=list(PARTS), metavar="part", help=f"any of {', '.join(PARTS)}")
    parser.add_argument("--seconds", type=float, default=10.0, help="to play for, each (%(default)g)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    if reason := why_not():
        sys.exit(f"no link can be made here: {reason}")
    with tempfile.TemporaryDirectory(prefix="srt3d-two-machines-") as folder:
        for part in args.parts:
            found = []
            for line in PARTS[part](Path(folder), args.seconds):
                found.append(line)
                yield {"part": part, **line}
            table = aligned([list(found[0]), *([str(value) for value in line.values()] for line in found)])
            print(f"\n{part}\n\n{table}\n", flush=True)


def photon_file(folder: Path, side: int, ppp: float = 10) -> str:
    """The path of a photon file of the head, made when it is first asked for."""
    path = folder / f"{side}_{ppp:g}.npz"
    if not path.exists():
        sensor = frames.sensor_of(side)
        npz.save(path, sensor, frames.photons_of(sensor, ppp))
    return str(path)


def sketch_bytes(side: int, layout: str, size: int) -> int:
    """Of a sketch's data, as in msg_schemas/."""
    return side**2 * (4 + size * {"int16": 4, "float32": 8}[layout])


def sketches(folder: Path, seconds: float, mbit: float, side: int, layout: str, size: int, rate_hz: float,
             loss: float = 0, profile: str = "default", reader: str = "") -> dict:
    """Sketches over a link, to a reader that only notes when they come or to a reconstructor; what came of it."""
    own, sent = folder / "own.xml", round(rate_hz * seconds)
    own.write_text(OWN_PROFILE)
    chosen = {OWN: str(own), "network": NETWORK_PROFILE}.get(profile)
    path = photon_file(folder, side)
    with Link(mbit) as link, Machines(link, folder) as machines:
        if loss:
            link.lose(loss)
        if reader:
            machines.start_on(ROBOT, reader)
        watch = machines.watch("points" if reader else "sketch", str(own) if profile == OWN else None)
        machines.start_on(SENSOR, "sketcher", chosen, layout=layout, sketch_size=size)
        for name in filter(None, ("sketcher", reader)):
            machines.wait(lambda: name in watch.reports, name)
        before = link.wire_bytes()
        machines.start_on(SENSOR, "player", input=path, rate_hz=rate_hz, frames=sent)
        machines.wait(lambda: watch.total("player", "frames_sent") >= sent, "the player", 10 * seconds + SILENCE_S)
        arrived = -1
        while arrived < len(watch.arrivals):
            arrived = len(watch.arrivals)
            time.sleep(SILENCE_S)
        wire = link.wire_bytes() - before
        first_ns, last_ns = (watch.arrivals[0].stamp_ns, watch.arrivals[-1].received_ns) if arrived else (0, np.inf)
        return {"mbit": mbit, "loss": loss, "profile": profile, "side": side, "layout": layout, "m": size,
                "rate_hz": rate_hz, "reader": reader or "note", "frames": sent, **seen(watch),
                "dropped_by_sketcher": watch.total("sketcher", "dropped"),
                "lost_before_sketcher": watch.total("sketcher", "message_lost"),
                "predicted_mbit": round(sketch_bytes(side, layout, size) * 8e-6 * rate_hz, 1),
                "wire_mbit": round(wire * 8e-6 / ((last_ns - first_ns) * 1e-9 + 1 / rate_hz), 1),
                "wire_bytes_per_frame": round(wire / max(arrived, 1))}


def seen(watch: Watch) -> dict:
    """Count and latencies of what arrived."""
    late_ms = percentiles([arrival.latency_ms for arrival in watch.arrivals])
    return {"arrived": len(watch.arrivals), **{f"latency_{name}_ms": value for name, value in late_ms.items()}}


def limits(folder: Path, seconds: float) -> Iterator[dict]:
    """All sizes of a sketch over both links."""
    yield sketches(folder, seconds, 100, *LIMITS[0], reader="reconstructor")
    for mbit, profile in ((100, "default"), (1000, "default"), (1000, "network")):
        for case in LIMITS:
            yield sketches(folder, seconds, mbit, *case, profile=profile)


def losses(folder: Path, seconds: float) -> Iterator[dict]:
    """Each profile on links that lose packets."""
    for loss in (0, 0.001, 0.01):
        for profile in PROFILES:
            yield sketches(folder, seconds, 100, *LIMITS[0], loss=loss, profile=profile)


def photons(folder: Path, seconds: float) -> Iterator[dict]:
    """The raw photons over 100 Mbit/s: the sketcher is at the robot."""
    with Link(100) as link, Machines(link, folder) as machines:
        watch = machines.watch("sketch")
        nodes = {"sketcher": machines.start_on(ROBOT, "sketcher", **SKETCHER)}
        machines.wait(lambda: "sketcher" in watch.reports, "the sketcher")
        nodes["player"] = machines.start_on(SENSOR, "player", input=photon_file(folder, SMALL, RAW_PPP), rate_hz=RAW_HZ)
        machines.wait(lambda: "player" in watch.reports, "the player")
        before, started = link.wire_bytes(), time.monotonic()
        held_mb: dict[str, list[float]] = {name: [] for name in nodes}
        while (elapsed_s := time.monotonic() - started) < 3 * seconds:
            for name, process in nodes.items():
                held_mb[name].append(status_bytes("VmRSS", Path(f"/proc/{process.pid}")) * 1e-6)
            time.sleep(1)
        wire = link.wire_bytes() - before
        line = {"ppp": RAW_PPP, "rate_hz": RAW_HZ, "seconds": round(elapsed_s), "due": round(elapsed_s * RAW_HZ),
                "needed_mbit": round(SMALL**2 * RAW_PPP * RAW_BYTES * 8e-6 * RAW_HZ), **seen(watch),
                "wire_mbit": round(wire * 8e-6 / elapsed_s, 1),
                "alive": all(process.running for process in nodes.values())}
        for name in nodes:      # at the beginning, in the middle and at the end: whether it grows
            line[f"{name}_mb"] = [round(float(part.max())) for part in np.array_split(held_mb[name], 3)]
            line[name] = {key: watch.reports[name].get(key, "") for key in COUNTS}
        yield line


def outages(folder: Path, seconds: float) -> Iterator[dict]:
    """The cable pulled and put in again, then each node killed and started again."""
    with Link(100) as link, Machines(link, folder) as machines:
        watch = machines.watch("sketch")
        machines.start_on(SENSOR, "sketcher", **SKETCHER)
        machines.wait(lambda: "sketcher" in watch.reports, "the sketcher")
        machines.start_on(SENSOR, "player", input=photon_file(folder, SMALL), rate_hz=10.0)
        for outage_s in OUTAGES_S:
            machines.wait(lambda: len(watch.arrivals) > 20, "sketches")
            link.unplug()
            time.sleep(outage_s)
            yield {"what": f"cable out for {outage_s:g} s", **recovery(machines, watch, link.plug)}
        machines["watch"].stop()        # each reader at the robot costs the cable as much again
        machines.start_on(ROBOT, "reconstructor")
        clouds = machines.watch("points")
        machines.wait(lambda: clouds.arrivals, "clouds")
        for machine, name, parameters in ((ROBOT, "reconstructor", {}), (SENSOR, "sketcher", SKETCHER)):
            machines[name].kill()
            time.sleep(SILENCE_S)
            yield {"what": f"{name} killed and started again",
                   **recovery(machines, clouds, lambda: machines.start_on(machine, name, **parameters))}


def recovery(machines: Machines, watch: Watch, repair: Callable[[], object]) -> dict:
    """Repair what is broken; how long the first message took from then on, and how late it was and those after it."""
    watch.arrivals.clear()
    started = time.monotonic()
    repair()
    machines.wait(lambda: watch.arrivals, "the first message")
    elapsed_s = time.monotonic() - started
    machines.wait(lambda: len(watch.arrivals) > 20, "20 more")
    late_ms = [arrival.latency_ms for arrival in watch.arrivals]
    return {"first_after_s": round(elapsed_s, 2), "first_late_ms": round(late_ms[0]),
            "then_late_ms": round(float(np.median(late_ms[1:])))}


PARTS: dict[str, Callable[[Path, float], Iterator[dict]]] = {
    "limits": limits, "loss": losses, "photons": photons, "outage": outages}
