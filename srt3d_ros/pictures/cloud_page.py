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
    shown = [name for name, one in QUANTITIES.items() if np.isfinite(one.values(cloud)).any() or not len(cloud)]
    eye = look_at(cloud.xyz, cloud.sensor.projection, _YAW_DEG, _PITCH_DEG)
    quantities, levels = [], []
    for style in (CloudStyle.of(cloud, cloud.sensor, name) for name in shown):
        quantity = style.quantity
        quantities.append({"label": f"{quantity.label}, {quantity.unit}".removesuffix(", "),
                           "ends": [quantity.text(end) for end in style.ends], "shaded": quantity is RANGE,
                           "table": base64.b64encode(quantity.table.tobytes()).decode()})
        levels.append(quantity.levels(quantity.values(cloud), style.ends).tobytes())
    facts = {"words": f"{len(cloud):,} points from {cloud.photons:,} photons of {cloud.sensor.rows} × "
                      f"{cloud.sensor.cols} pixels, by {cloud.method}".removesuffix(", by "),
             "notes": notes, "frame": printable(cloud.sensor.frame_id), "count": len(cloud), "quantities": quantities,
             "size": records.itemsize, "fields": {name: (records.dtype[name].str, records.dtype.fields[name][1])
                                                  for name in records.dtype.names},
             "axes": sensor_axes(cloud.sensor.projection).tolist(), "target": eye.target.tolist(),
             "distance": float(np.linalg.norm(eye.position - eye.target)), "fov_deg": eye.fov_deg,
             "yaw": np.radians(_YAW_DEG), "pitch": np.radians(_PITCH_DEG),
             "radius_m": style.radius_m}
    page = Path(__file__).with_suffix(".html").read_text(encoding="utf-8")
    points = base64.b64encode(records.tobytes() + b"".join(levels)).decode()
    text = json.dumps(facts).replace("<", r"\u003c")      # no note can end the script
    path.write_text(page.replace("@FACTS@", text).replace("@POINTS@", points), encoding="utf-8")
