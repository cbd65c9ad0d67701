"""FaultTestbed: the pipeline with recorders and a driver that can misbehave."""

import time
from collections import Counter
from pathlib import Path

import numpy as np
from sensor_msgs.msg import PointCloud2

from robustness.testbed import Testbed
from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets.scene import StaticScene
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.messages import points as points_message
from srt3d_ros.processes import Process

PLANE_M, PPP, SBR, PACKETS = 3.0, 20.0, 4.0, 4
NEAR_M = 0.06               # of a median of hundreds of points from the plane: bins are up to 3 cm
ENOUGH = 0.9                # of the pixels have a point
SUFFIX = {"recorder": ".rrd", "bag_recorder": ".bag"}
IRF = np.exp(-0.5 * (np.arange(15) - 7) ** 2 / 4)
USUAL = SensorModel(24, 32, 300, 1e-10, IRF, frame_id="spad", projection=Pinhole.from_fov(24, 32, 20.0))
SENSORS = {"usual": USUAL, "size": USUAL.replace(rows=33, cols=20, projection=Pinhole.from_fov(33, 20, 20.0)),
           "T": USUAL.replace(num_bins=170, bin_width_s=2e-10),
           "IRF": USUAL.replace(irf=np.array([0.5, 1.0, 0.8, 0.4, 0.2, 0.1]), irf_ref=1)}


class FaultTestbed(Testbed):
    """Sketcher, reconstructor, recorder, bag recorder and driver.

    Args:
        folder: for recordings, bags and packets.

    Attributes:
        clouds: stamp and number of points of those that came since somebody began to wait for one.
        misplaced: median ranges of clouds that show a surface where there is none.
        recorded: finished recordings and bags to check: of which node, where, whether it ended in order.
    """

    def __init__(self, folder: Path):
        self.sensor = "usual"
        super().__init__({name: {"path": str(folder / f"000{suffix}")} for name, suffix in SUFFIX.items()} | {
            "reconstructor": {}, "sketcher": {"frame_period_s": 0.1, "gap_s": 1.0}}, folder)
        self.clouds: list[tuple[int, int]] = []
        self.misplaced: list[float] = []
        self.recorded: list[tuple[str, Path, bool]] = []
        for name, sensor in SENSORS.items():
            scene = StaticScene(np.full((sensor.rows, sensor.cols), PLANE_M))
            simulators = [Simulator(scene, sensor, sbr=SBR, ppp=PPP / PACKETS, seed=k) for k in range(PACKETS)]
            self.write_packets(name, sensor, [simulator.frame(0)[0] for simulator in simulators])

    def __enter__(self) -> "FaultTestbed":
        super().__enter__()
        try:
            self.probe.node.create_subscription(PointCloud2, "points", self._on_cloud, 100, raw=True)
            self.start("driver")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *exc) -> None:
        super().__exit__()
        for name in SUFFIX.keys() & self.keys():
            self._note_recorded(name)

    def start(self, name: str, *ros_args: str, **parameters) -> Process:
        """Start a node or the driver; a recorder begins another file, the driver sends."""
        if name in SUFFIX:
            parameters["path"] = str(self.folder / f"{self._number(name) + 1:03}{SUFFIX[name]}")
        process = super().start(name, *ros_args, **parameters)
        if name == "driver":
            self.drive(sensor=self.sensor)
        return process

    def remove(self, name: str) -> None:
        if name in SUFFIX:
            self._note_recorded(name)
        super().remove(name)

    def drive(self, **settings) -> Counter[str]:
        self.sensor = settings.get("sensor") or self.sensor
        return super().drive(**settings)

    def wait_for_cloud(self, timeout_s: float) -> float:
        """Seconds until a cloud of photons from now on comes, with as many points as it should have."""
        began_s, since_ns, enough = time.monotonic(), time.time_ns(), ENOUGH * SENSORS[self.sensor].pixels
        self.clouds.clear()
        self.wait(lambda: any(stamp_ns >= since_ns and points > enough for stamp_ns, points in self.clouds),
                  "a cloud", timeout_s)
        return time.monotonic() - began_s

    def _number(self, name: str) -> int:
        """How many processes a node had before this one."""
        return sum(name == other for other, _ in self.replaced)

    def _note_recorded(self, name: str) -> None:
        """All files of the node's last process: after an error it begins another."""
        parts = sorted(self.folder.glob(f"{self._number(name):03}*{SUFFIX[name]}"))
        self.recorded += [(name, part, self[name].returncode == 0) for part in parts]

    def _on_cloud(self, raw: bytes) -> None:
        header, columns = points_message.decode_cdr(raw)
        ranges = np.linalg.norm(columns["xyz"], axis=1)
        median_m = float(np.median(ranges)) if len(ranges) else PLANE_M
        self.clouds.append((header.stamp_ns, len(ranges)))
        if abs(median_m - PLANE_M) > NEAR_M:
            self.misplaced.append(median_m)
