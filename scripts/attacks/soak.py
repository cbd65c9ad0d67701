"""The pipeline for half an hour: does it grow, leak, slow down or lose anything?

    .venv/bin/python scripts/attacks/soak.py

The simulator's moving head at 10 Hz, 141 × 141 pixels, 15 photons per pixel, through player, sketcher, reconstructor
and recorder, each a process of its own with its default parameters, to this script, which subscribes. The recorder
begins a new file every five minutes or so: until a file is finished rerun keeps its index in memory, which grows in
steps and falls back with the file. Once a second the script reads what each process holds. After the warm-up, the last
minute is held against the first, and of the memory the highest in the time of one file:

    memory      resident, of no process more than 3 % more (the private part, `uss`, is told as well)
    files, threads, /dev/shm    no more than at any time until the end of the first minute
    latency     from the stamp to the cloud's arrival, 95 % of the clouds: within 10 %
    frames      sent = reconstructed = recorded: none lost, as the nodes count and as the recordings hold

Exit code 0 if all of that holds, 1 if not.
"""

import argparse
import os
import shutil
import sys
import time
from pathlib import Path

import numpy as np
from result import write_result
from soak_samples import Samples
from srt3d_ros.cli.processes import join_private_network
from stack import Stack
from tqdm import tqdm

from srt3d_ros.recording.reader import RecordingReader

LISTENERS = ("recorder", "reconstructor", "sketcher")       # started before the player
NODES = (*LISTENERS, "player")
PPP, SBR = 15.0, 1.0
FIRST_CLOUD_S, LAST_CLOUDS_S = 60.0, 60.0
LATENCY_PERCENT, LATENCY_PERCENTILE = 10.0, 95
COUNTED = ("fds", "threads")
COUNTS = ("dropped", "message_lost", "errors", "recording_dropped", "unaccounted_frames", "unaccounted_photons")
LEAST_SPLIT_MIN = 5.0
DOMAIN = "ROS_DOMAIN_ID"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0, help="default: %(default)g")
    parser.add_argument("--warm-up-minutes", type=float, help="default: 3, at most a fifth")
    parser.add_argument("--rate-hz", type=float, default=10.0, help="default: %(default)g")
    parser.add_argument("--input", default="simulator", help="photon file instead of the simulated head")
    parser.add_argument("--split-minutes", type=float, help="of a recorded file; default: 5 or more, so that the last "
                        "minute sees it at the same age as the first")
    parser.add_argument("--growth-percent", type=float, default=3.0, help="allowed of the memory; default: %(default)g")
    parser.add_argument("--lossless", action="store_true", help="let frames wait while a busy machine stalls")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build/attacks/soak.json"), help="default: %(default)s")
    parser.add_argument("--picture", type=Path, help="where to draw what was seen (.png)")
    parser.add_argument("--keep", action="store_true", help="keep all recordings, not only the first file")
    args = parser.parse_args()
    args.windows_s = windows_s(60 * args.minutes, args.warm_up_minutes)
    if args.split_minutes is None:
        apart_min = (args.windows_s[1][0] - args.windows_s[0][0]) / 60
        args.split_minutes = apart_min / max(apart_min // LEAST_SPLIT_MIN, 1)
    given = os.environ.get(DOMAIN)
    join_private_network()
    os.environ[DOMAIN] = given or os.environ[DOMAIN]
    folder = args.out.parent / "soak"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    result = write_result(args.out, judge(args, *soak(args, folder), folder))
    if args.picture:
        from soak_picture import draw
        draw(result, args.picture)
    for part in [] if args.keep else sorted(folder.glob("*.rrd"))[1:]:
        part.unlink()
    failed = [line for line in result["verdicts"] if not line["holds"]]
    for line in result["verdicts"]:
        print(f"{'holds' if line['holds'] else 'FAILS'}  {line['what']}: {line['seen']} (allowed: {line['allowed']})")
    print(f"soak of {args.minutes:g} min: {'FAILS' if failed else 'holds'}; {args.out}")
    return bool(failed)


def soak(args: argparse.Namespace, folder: Path) -> tuple[Samples, dict, dict[str, dict[str, str]], list[str]]:
    """Run it: the samples, when clouds arrived and how late in ms, the nodes' last reports, who ended too early."""
    frames = round(60 * args.minutes * args.rate_hz)
    recorder = {"path": str(folder / "soak.rrd"), "split_period_s": 60 * args.split_minutes}
    every = {"lossless": True} if args.lossless else {}
    with Stack({"recorder": recorder | every, "reconstructor": every, "sketcher": every}) as stack:
        arrivals = stack.monitor.arrivals
        stack.start("player", input=args.input, ppp=PPP, sbr=SBR, seed=args.seed, rate_hz=args.rate_hz, frames=frames,
                    **every)
        stack.wait(lambda: arrivals, "a cloud", FIRST_CLOUD_S)
        begun_s, begun_ns = time.monotonic(), time.time_ns()
        samples = Samples({name: process.pid for name, process in stack.processes.items()})
        for second in tqdm(range(int(60 * args.minutes) - 1), unit="s", mininterval=1 if sys.stderr.isatty() else 30):
            samples.take(float(second))         # when it was due: no window is without
            stack.spin(max(begun_s + second + 1 - time.monotonic(), 0))
            if stack.dead():
                break
        stack.wait(lambda: not stack.processes["player"].running, "", LAST_CLOUDS_S, must=False)
        ended = [line for line in stack.dead() if not line.startswith("player ended with 0")]
        stack.wait(lambda: len(arrivals) >= frames, "", LAST_CLOUDS_S, must=False)
        stack.settle(LISTENERS)
        latencies = {"arrived_s": [(one.received_ns - begun_ns) * 1e-9 for one in arrivals],
                     "ms": [one.latency_ms for one in arrivals]}
        return samples, latencies, stack.counts.latest, ended


def windows_s(seconds: float, warm_up_minutes: float | None) -> tuple[tuple[float, float], tuple[float, float]]:
    """The first and the last minute that are held against each other; less than minutes where there are not six."""
    begin = min(180.0, seconds / 5) if warm_up_minutes is None else 60 * warm_up_minutes
    length, end = min(60.0, (seconds - begin) / 3), seconds - 1
    return (begin, begin + length), (end - length, end)


def one_file_each(windows, file_s: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """The time of one recorded file after the warm-up, and before the end; less where there are not two."""
    begin, end = windows[0][0], windows[1][1]
    length = min(file_s, (end - begin) / 2)
    return (begin, begin + length), (end - length, end)


def judge_memory(held: dict, time_s: np.ndarray, files, most_percent: float) -> list[dict]:
    """The highest memory of each process in the time of the last file against that in the first."""
    verdicts = []
    for name in NODES:
        (rss, rss_after), (uss, uss_after) = (
            [np.array(held[name][kind])[(begin <= time_s) & (time_s <= end)].max() for begin, end in files]
            for kind in ("rss_mb", "uss_mb"))
        grown, private = 100 * (rss_after / rss - 1), 100 * (uss_after / uss - 1)
        verdicts.append(verdict(f"{name}, memory", f"{grown:+.2f} % of {rss:.0f} MB (private: {private:+.2f} % of "
                                f"{uss:.0f} MB)", f"+{most_percent:g} %", grown < most_percent))
    return verdicts


def judge(args, samples: Samples, latencies: dict, reports: dict, problems: list[str], folder: Path) -> dict:
    """All that was seen, and what to say of it."""
    windows, time_s = args.windows_s, np.array(samples.time_s)
    last = (windows[1][0] <= time_s) & (time_s <= windows[1][1])
    verdicts = [verdict("ended before it was asked to", "; ".join(problems) or "none", "none", not problems)]
    files = one_file_each(windows, 60 * args.split_minutes)
    verdicts += judge_memory(samples.held, time_s, files, args.growth_percent)
    shared = {"/dev/shm, entries": samples.shm_entries, "/dev/shm, MB": np.round(samples.shm_mb, 1)}
    for what, counts in (*((f"{name}, {kind}", samples.held[name][kind]) for name in NODES for kind in COUNTED),
                         *shared.items()):
        before, after = (int(np.max(np.array(counts)[then])) for then in (time_s <= windows[0][1], last))
        verdicts.append(verdict(what, str(after), str(before), after <= before))
    arrived_s, ms = np.array(latencies["arrived_s"]), np.array(latencies["ms"])
    before, after = (np.percentile(seen, LATENCY_PERCENTILE) if len(seen) else np.nan for begin, end in windows
                     for seen in [ms[(begin <= arrived_s) & (arrived_s <= end)]])
    verdicts.append(verdict(f"latency, {LATENCY_PERCENTILE} %", f"{after:.1f} ms, {100 * (after / before - 1):+.1f} %",
                            f"{before:.1f} ms + {LATENCY_PERCENT:g} %", after <= before * (1 + LATENCY_PERCENT / 100)))
    verdicts += judge_frames(args, len(ms), reports, folder)
    return {"what": "soak", "seed": args.seed,
            "holds": all(line["holds"] for line in verdicts), "verdicts": verdicts,
            "figures": {"minutes": args.minutes, "rate_hz": args.rate_hz, "windows_s": windows, "files_s": files,
                        "growth_percent": args.growth_percent,
                        "latency_limit_ms": round(before * (1 + LATENCY_PERCENT / 100), 1), "reports": reports},
            "samples": {"time_s": np.round(samples.time_s, 2).tolist(), "shm_entries": samples.shm_entries,
                        "shm_mb": np.round(samples.shm_mb, 2).tolist(),
                        **{name: {kind: np.round(values, 2).tolist() for kind, values in held.items()}
                           for name, held in samples.held.items()}},
            "latency": {"arrived_s": np.round(arrived_s, 2).tolist(), "ms": np.round(ms, 2).tolist()}}


def judge_frames(args, clouds: int, reports: dict, folder: Path) -> list[dict]:
    """Whether every frame became a cloud and was recorded, and nothing was dropped or lost on the way."""
    sent = int(reports["player"]["frames_sent"])
    parts = sorted(folder.glob("*.rrd"))
    recorded = sum(len(RecordingReader(part).cloud_index()) for part in parts)
    counts = {f"{name} {key}": int(value) for name, values in reports.items() for key, value in values.items()
             if key in COUNTS}
    wrong = [f"{what} {count}" for what, count in counts.items() if count]
    size_gb = sum(part.stat().st_size for part in parts) * 1e-9
    return [verdict("frames sent", str(sent), str(round(60 * args.minutes * args.rate_hz)),
                    sent == round(60 * args.minutes * args.rate_hz)),
            verdict("clouds received", str(clouds), str(sent), clouds == sent),
            verdict(f"clouds in {len(parts)} recordings of {size_gb:.2f} GB", str(recorded), str(sent),
                    recorded == sent),
            verdict("dropped, lost, errors, as the nodes count", ", ".join(wrong) or "none", "none", not wrong)]


def verdict(what: str, seen: str, allowed: str, holds: bool) -> dict:
    """A line of the result."""
    return {"what": what, "seen": seen, "allowed": allowed, "holds": bool(holds)}


if __name__ == "__main__":
    sys.exit(main())
