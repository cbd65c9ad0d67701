"""Compare two recordings frame by frame: points, the distance between the clouds, latency."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree
from tqdm import tqdm

from srt3d_ros.errors import require
from srt3d_ros.recording.reader import RecordedCloud
from srt3d_ros.review.recorded import Recorded
from srt3d_ros.review.summary import align, latency, spread

_MM_PER_M = 1e3
_DECIMALS = 4


def compare(ours: Recorded, theirs: Recorded) -> dict:
    """The differences, as a dictionary for JSON.

    matched_by ("stamp", or "frame" if no stamp is in both), frames (in both), only_in_first, only_in_second;
    points_first, points_second and points_difference (second − first): median, min, max over the frames;
    distance_mm: from each point of either cloud to the nearest of the other, its mean, median and 95th percentile over
    all points of a frame, the median frame's and the worst frame's; identical_frames; latency_ms of both.

    Raises:
        InvalidInput: if no frame is in both.
    """
    matched_by, pairs = _match(ours, theirs)
    first, second = np.array(pairs).T
    points = ours.points[first], theirs.points[second]
    distances = [nearest_mm(a, b) for a, b in _clouds(ours, theirs, pairs)]
    return {
        "first": str(ours.path), "second": str(theirs.path), "matched_by": matched_by, "frames": len(pairs),
        "only_in_first": len(ours.index) - len(pairs), "only_in_second": len(theirs.index) - len(pairs),
        "points_first": spread(points[0]), "points_second": spread(points[1]),
        "points_difference": spread(points[1] - points[0]),
        "distance_mm": _over_frames([distance for distance in distances if distance is not None]),
        "identical_frames": sum(distance is not None and distance[3] == 0 for distance in distances),
        "latency_ms": {name: {stage: latency(series.values) for stage, series in recorded.latencies().items()}
                       for name, recorded in (("first", ours), ("second", theirs))},
    }


def nearest_mm(ours: np.ndarray, theirs: np.ndarray) -> tuple[float, float, float, float] | None:
    """Distance of each point [N, 3] (metres) of either cloud to the nearest of the other, in millimetres.

    Returns:
        Mean, median, 95th percentile and maximum; None unless both clouds have finite points.
    """
    ours, theirs = (xyz[np.isfinite(xyz).all(axis=1)] for xyz in (ours, theirs))
    if not len(ours) or not len(theirs):
        return None
    distance = np.concatenate([cKDTree(b).query(a, workers=-1)[0] for a, b in ((ours, theirs), (theirs, ours))])
    distance *= _MM_PER_M
    return (float(distance.mean()), *(float(np.percentile(distance, p)) for p in (50, 95, 100)))


def format_comparison(comparison: dict) -> str:
    """The comparison for a terminal."""
    c = comparison
    by = "by stamp" if c["matched_by"] == "stamp" else "by frame index: no stamp is in both"
    lines = [("first", c["first"]), ("second", c["second"]),
             ("frames in both", f"{c['frames']:,} ({by}); {c['only_in_first']:,} only in the first, "
                                f"{c['only_in_second']:,} only in the second"),
             ("points a frame", f"{c['points_first']['median']:,.0f} and {c['points_second']['median']:,.0f}, "
                                f"difference {c['points_difference']['min']:+,.0f} … "
                                f"{c['points_difference']['max']:+,.0f}")]
    lines += [(f"distance, {name}", f"mean {v['mean']:.4g} mm, median {v['median']:.4g} mm, 95 % {v['p95']:.4g} mm")
              for name, v in c["distance_mm"].items()]
    lines.append(("identical clouds", f"{c['identical_frames']:,} of {c['frames']:,}"))
    for stage in dict.fromkeys([*c["latency_ms"]["first"], *c["latency_ms"]["second"]]):
        both = [c["latency_ms"][name].get(stage) for name in ("first", "second")]
        lines.append(("latency" if stage == "total" else f"latency, {stage}", " and ".join(
            f"median {v['p50']:,.1f} ms, 95 % {v['p95']:,.1f} ms" if v else "not recorded" for v in both)))
    return align(lines)


def _match(ours: Recorded, theirs: Recorded) -> tuple[str, list[tuple[int, int]]]:
    """"stamp" or "frame", and the positions of the frames in both, sorted by the first recording's stamps."""
    for name, attribute in (("stamp", "stamp_ns"), ("frame", "frame_index")):
        keys = [getattr(recorded.index, attribute) for recorded in (ours, theirs)]
        _, first, second = np.intersect1d(*keys, return_indices=True)
        if len(first):
            return name, sorted(zip(first.tolist(), second.tolist()))
    require(False, "recording", str(theirs.path), f"a frame that {ours.path} holds too, by stamp or by index")


def _clouds(ours: Recorded, theirs: Recorded, pairs: list[tuple[int, int]]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The positions of matched clouds. Only clouds that come before their partner in the file are held in memory."""
    partner = {int(ours.index.frame_index[a]): int(theirs.index.frame_index[b]) for a, b in pairs}
    others, waiting = theirs.reader.clouds(set(partner.values())), {}
    for cloud in tqdm(ours.reader.clouds(partner), "comparing", len(pairs), delay=2, leave=False, unit="frame"):
        wanted = partner[cloud.frame_index]
        while wanted not in waiting:
            other: RecordedCloud = next(others)
            waiting[other.frame_index] = other.xyz
        yield cloud.xyz, waiting.pop(wanted)


def _over_frames(distances: list[tuple[float, float, float, float]]) -> dict:
    """The distances of the median frame and of the worst frame; empty without any."""
    if not distances:
        return {}
    table = np.array(distances)[:, :3]
    return {name: dict(zip(("mean", "median", "p95"), np.round(over(table, axis=0), _DECIMALS).tolist()))
            for name, over in (("median frame", np.median), ("worst frame", np.max))}
