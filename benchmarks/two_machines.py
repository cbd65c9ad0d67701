"""Sketcher and reconstructor on two machines joined by 100 Mbit/s or 1 Gbit/s: what passes, how late, at what loss.

    sudo env PYTHONPATH=. .venv/bin/python benchmarks/two_machines.py [photons limits loss outage] [--out lines.jsonl]

The machines are network namespaces (link.py): needs root and iproute2. Prints tables in Markdown;
docs/deployment.md has them.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from link import ROBOT, SENSOR, Link, why_not
from machines import NETWORK_PROFILE, Machines, Watch, resident_mb

from srt3d_ros.benchmark import frames
from srt3d_ros.datasets import npz
from srt3d_ros.evaluation.machine import machine

PROFILES = ("Fast DDS's own", "default", "network")     # of the sketcher; docs/deployment.md
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


def sketch_bytes(side: int, layout: str, size: int) -> int:
    """Of a sketch's data, as in msg_schemas/."""
    return side**2 * (4 + size * {"int16": 4, "float32": 8}[layout])


class Scene:
    """Photon files of the head, made when first asked for."""

    def __init__(self, folder: Path):
        self._folder = folder

    def path(self, side: int, ppp: float = 10) -> str:
        path = self._folder / f"{side}_{ppp:g}.npz"
        if not path.exists():
            sensor = frames.sensor_of(side)
            npz.save(path, sensor, frames.photons_of(sensor, ppp))
        return str(path)


class Bench:
    """Runs pipelines over links.

    Args:
        folder: for photon files and logs.
        seconds: to play for.
    """

    def __init__(self, folder: Path, seconds: float):
        self.scene, self.folder, self.seconds = Scene(folder), folder, seconds
        own = folder / "own.xml"
        own.write_text(OWN_PROFILE)
        self._profiles = dict(zip(PROFILES, (str(own), None, NETWORK_PROFILE)))

    def sketches(self, mbit: float, side: int, layout: str, size: int, rate_hz: float, loss: float = 0,
                 profile: str = "default", reader: str = "") -> dict:
        """Sketches over the link, to a reader that only notes when they come or to a reconstructor; what came of it."""
        sent = round(rate_hz * self.seconds)
        path, chosen = self.scene.path(side), self._profiles[profile]
        with Link(mbit) as link, Machines(link, self.folder) as machines:
            if loss:
                link.lose(loss)
            if reader:
                machines.start(ROBOT, reader)
            watch = machines.watch("points" if reader else "sketch", profile=chosen if profile == PROFILES[0] else None)
            machines.start(SENSOR, "sketcher", chosen, layout=layout, sketch_size=size)
            ready(machines, watch, "sketcher", *([reader] if reader else []))
            before = link.wire_bytes()
            machines.start(SENSOR, "player", input=path, rate_hz=rate_hz, frames=sent)
            machines.wait(lambda: watch.total("player", "frames_sent") >= sent, "the player",
                          10 * self.seconds + SILENCE_S)
            until_silent(watch)
            wire = link.wire_bytes() - before
            return {"mbit": mbit, "loss": loss, "profile": profile, "side": side, "layout": layout, "m": size,
                    "rate_hz": rate_hz, "reader": reader or "note", "frames": sent, **seen(watch),
                    "dropped_by_sketcher": watch.total("sketcher", "dropped"),
                    "lost_before_sketcher": watch.total("sketcher", "message_lost"),
                    "predicted_mbit": round(sketch_bytes(side, layout, size) * 8e-6 * rate_hz, 1),
                    "wire_mbit": round(wire * 8e-6 / span_s(watch, rate_hz), 1),
                    "wire_bytes_per_frame": round(wire / max(len(watch.arrivals), 1))}

    def photons(self) -> dict:
        """The raw photons over 100 Mbit/s: the sketcher is at the robot."""
        with Link(100) as link, Machines(link, self.folder) as machines:
            watch = machines.watch("sketch")
            sketcher = machines.start(ROBOT, "sketcher", layout="int16", sketch_size=5)
            ready(machines, watch, "sketcher")
            path = self.scene.path(SMALL, RAW_PPP)
            player = machines.start(SENSOR, "player", input=path, rate_hz=RAW_HZ)
            machines.wait(lambda: watch.reports("player"), "the player")
            before, started, held_mb = link.wire_bytes(), time.monotonic(), []
            while (elapsed_s := time.monotonic() - started) < 3 * self.seconds:
                held_mb.append((resident_mb(player), resident_mb(sketcher)))
                time.sleep(1)
            wire = link.wire_bytes() - before
            third = len(held_mb) // 3
            line = {"ppp": RAW_PPP, "rate_hz": RAW_HZ, "seconds": round(elapsed_s), "due": round(elapsed_s * RAW_HZ),
                    "needed_mbit": round(SMALL**2 * RAW_PPP * RAW_BYTES * 8e-6 * RAW_HZ), **seen(watch),
                    "wire_mbit": round(wire * 8e-6 / elapsed_s, 1),
                    "alive": player.poll() is None and sketcher.poll() is None,
                    "player_mb": [round(max(held[0] for held in part)) for part in thirds(held_mb, third)],
                    "sketcher_mb": [round(max(held[1] for held in part)) for part in thirds(held_mb, third)]}
            for node in ("player", "sketcher"):
                line[node] = {key: watch.value(node, key) for key in
                              ("message", "frames_in", "frames_out", "dropped", "message_lost", "latency_p50_ms")}
            return line

    def outages(self) -> Iterator[dict]:
        """The cable pulled and put in again, then the robot's reader killed and started again."""
        with Link(100) as link, Machines(link, self.folder) as machines:
            watch = machines.watch("sketch")
            machines.start(SENSOR, "sketcher", layout="int16", sketch_size=5)
            ready(machines, watch, "sketcher")
            machines.start(SENSOR, "player", input=self.scene.path(SMALL), rate_hz=10.0)
            for seconds in OUTAGES_S:
                machines.wait(lambda: len(watch.arrivals) > 20, "sketches")
                link.unplug()
                time.sleep(seconds)
                watch.arrivals.clear()
                yield {"what": f"cable out for {seconds:g} s", **back(machines, watch, link.plug)}
            machines.stop(watch.process)        # each reader at the robot costs the cable as much again
            machines.start(ROBOT, "reconstructor")
            clouds = machines.watch("points")
            machines.wait(lambda: clouds.arrivals, "clouds")
            for what in ("reconstructor", "sketcher"):
                yield {"what": f"{what} killed and started again", **self._killed(what, machines, clouds)}

    def _killed(self, name: str, machines: Machines, clouds: Watch) -> dict:
        where = ROBOT if name == "reconstructor" else SENSOR
        parameters = {} if name == "reconstructor" else {"layout": "int16", "sketch_size": 5}
        victim = next(process for process in machines.running if name in process.args)
        victim.kill()
        victim.wait()
        time.sleep(SILENCE_S)
        clouds.arrivals.clear()
        return back(machines, clouds, lambda: machines.start(where, name, **parameters))


def ready(machines: Machines, watch: Watch, *names: str) -> None:
    """Wait until the robot sees these nodes' diagnostics."""
    for name in names:
        machines.wait(lambda: watch.reports(name), name)


def until_silent(watch: Watch) -> None:
    """Wait until nothing has come for a while."""
    before = -1
    while before < len(watch.arrivals):
        before = len(watch.arrivals)
        time.sleep(SILENCE_S)


def back(machines: Machines, watch: Watch, mend: Callable[[], object]) -> dict:
    """Mend what is broken; how long the first message took from then on, and how late it was and those after it."""
    started = time.monotonic()
    mend()
    machines.wait(lambda: watch.arrivals, "the first message")
    elapsed_s = time.monotonic() - started
    machines.wait(lambda: len(watch.arrivals) > 20, "20 more")
    late_ms = [arrival.latency_ms for arrival in watch.arrivals]
    return {"first_after_s": round(elapsed_s, 2), "first_late_ms": round(late_ms[0]),
            "then_late_ms": round(float(np.median(late_ms[1:])))}


def seen(watch: Watch) -> dict:
    """Count and latencies of what arrived."""
    late_ms = [arrival.latency_ms for arrival in watch.arrivals]
    percentiles = np.percentile(late_ms, [50, 95, 100]) if late_ms else [np.nan] * 3
    return {"arrived": len(late_ms), **{f"latency_{name}_ms": round(float(value), 1)
                                        for name, value in zip(("p50", "p95", "max"), percentiles)}}


def span_s(watch: Watch, rate_hz: float) -> float:
    """From the first frame's stamp to the last arrival, and a frame more."""
    if not watch.arrivals:
        return np.inf
    return (watch.arrivals[-1].received_ns - watch.arrivals[0].stamp_ns) * 1e-9 + 1 / rate_hz


def thirds(values: list, third: int) -> tuple[list, list, list]:
    """The beginning, the middle and the end, to see whether something grows."""
    return values[:third], values[third:2 * third], values[2 * third:]


def limits(bench: Bench) -> Iterator[dict]:
    yield bench.sketches(100, *LIMITS[0], reader="reconstructor")
    for mbit in (100, 1000):
        for case in LIMITS:
            yield bench.sketches(mbit, *case)
            if mbit == 1000:
                yield bench.sketches(mbit, *case, profile="network")


def losses(bench: Bench) -> Iterator[dict]:
    for loss in (0, 0.001, 0.01):
        for profile in PROFILES:
            yield bench.sketches(100, *LIMITS[0], loss=loss, profile=profile)


PARTS: dict[str, Callable[[Bench], Iterator[dict]]] = {
    "limits": limits, "loss": losses, "photons": lambda bench: iter([bench.photons()]), "outage": Bench.outages}


def table(lines: list[dict]) -> str:
    """Lines with the same keys, in Markdown."""
    rows = [list(lines[0]), ["---"] * len(lines[0]), *([str(value) for value in line.values()] for line in lines)]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=list(PARTS), metavar="part", help=f"any of {', '.join(PARTS)}")
    parser.add_argument("--seconds", type=float, default=10.0, help="to play for, each (%(default)s)")
    parser.add_argument("--out", type=Path, help="write every line there, as JSON")
    args = parser.parse_args()
    reason = why_not()
    if reason:
        raise SystemExit(f"no link can be made here: {reason}")
    lines = [{"part": "machine", **machine()}]
    with tempfile.TemporaryDirectory(prefix="srt3d-two-machines-") as folder:
        bench = Bench(Path(folder), args.seconds)
        for part in args.parts:
            found = []
            for line in PARTS[part](bench):
                found.append(line)
                print(json.dumps(line), flush=True)
            print(f"\n{part}\n\n{table(found)}\n", flush=True)
            lines += [{"part": part, **line} for line in found]
    if args.out:
        args.out.write_text("".join(json.dumps(line) + "\n" for line in lines))


if __name__ == "__main__":
    main()
