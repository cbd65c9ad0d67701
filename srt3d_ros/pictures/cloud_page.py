"""Write a cloud as one HTML page, in which it can be turned without a server or a network."""

import base64
import json
from pathlib import Path

import numpy as np

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.errors import printable
from srt3d_ros.pictures.cloud_renderer import CloudStyle
from srt3d_ros.pictures.quantities import QUANTITIES, RANGE
from srt3d_ros.pictures.viewpoint import look_at, sensor_axes

_YAW_DEG, _PITCH_DEG = 15.0, 10.0


def write_page(cloud: PointCloud, records: np.ndarray, path: Path, notes: tuple[str, ...]) -> None:
    """Write cloud_page.html with the points: `records` [N] with x, y, z in metres, …, behind them the colours' levels.

    Quantities that the method does not give are left out.
    """
    styles = [CloudStyle.of(cloud, cloud.sensor, name) for name, one in QUANTITIES.items()
              if np.isfinite(one.values(cloud)).any() or not len(cloud)]
    eye = look_at(cloud.xyz, cloud.sensor.projection, _YAW_DEG, _PITCH_DEG)
    quantities = [{"label": f"{one.label}, {one.unit}".removesuffix(", "), "ends": [one.text(end) for end in ends],
                   "shaded": one is RANGE, "table": base64.b64encode(one.table.tobytes()).decode()}
                  for one, ends in ((style.quantity, style.ends) for style in styles)]
    levels = [style.quantity.levels(style.quantity.values(cloud), style.ends).tobytes() for style in styles]
    facts = {"words": f"{len(cloud):,} points from {cloud.photons:,} photons of {cloud.sensor.rows} × "
                      f"{cloud.sensor.cols} pixels, by {cloud.method}".removesuffix(", by "),
             "notes": notes, "frame": printable(cloud.sensor.frame_id), "count": len(cloud), "quantities": quantities,
             "size": records.itemsize, "fields": {
                 name: (field[0].str, field[1]) for name, field in (records.dtype.fields or {}).items()},
             "axes": sensor_axes(cloud.sensor.projection).tolist(), "target": eye.target.tolist(),
             "distance": float(np.linalg.norm(eye.position - eye.target)), "fov_deg": eye.fov_deg,
             "yaw": np.radians(_YAW_DEG), "pitch": np.radians(_PITCH_DEG),
             "radius_m": styles[0].radius_m}
    page = Path(__file__).with_suffix(".html").read_text(encoding="utf-8")
    points = base64.b64encode(records.tobytes() + b"".join(levels)).decode()
    text = json.dumps(facts).replace("<", r"\u003c")      # no note can end the script
    path.write_text(page.replace("@FACTS@", text).replace("@POINTS@", points), encoding="utf-8")
