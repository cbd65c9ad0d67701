"""FaultyStack: the pipeline under attack, its driver, its disks, and what of its clouds is right."""

import json
import shutil
import sys
import time
from collections import Counter
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from machine import Disk
from process import Process
from sensor_msgs.msg import PointCloud2
from services import become_known
from stack import Stack
from std_msgs.msg import String

from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets.scene import StaticScene
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes.topics import LATCHED

HERE = Path(__file__).resolve().parent
PLANE_M, PPP, SBR, PACKETS = 3.0, 20.0, 4.0, 4
NEAR_M = 0.06               # of a median of hundreds of points from the plane: bins are up to 3 cm
ENOUGH = 0.9                # of the pixels have a point
FRAME_S, GAP_S = 0.1, 1.0
RECORDERS = {"recorder": "rrd", "bag_recorder": "bag"}
AHEAD_NS = 60 * 10**9
USUAL = "usual"
ACQUAINTED_S, ANSWER_S = 0.5, 40.0      # a recorder finishes its file before it answers
DISK_MB, SHARED_MEMORY_MB = 256, 320


def sensors() -> dict[str, SensorModel]:
    """What the driver may be."""
    irf = np.exp(-0.5 * (np.arange(15) - 7) ** 2 / 4)
    usual = SensorModel(24, 32, 300, 1e-10, irf, frame_id="spad", projection=Pinhole.from_fov(24, 32, 20.0))
    larger = usual.replace(rows=33, cols=20, projection=Pinhole.from_fov(33, 20, 20.0))
    return {USUAL: usual, "another size": larger, "another T": usual.replace(num_bins=170, bin_width_s=2e-10),
            "another IRF": usual.replace(irf=np.array([0.5, 1.0, 0.8, 0.4, 0.2, 0.1]), irf_ref=1)}


@dataclass(frozen=True)
class Seen:
    """A cloud that arrived."""

    stamp_ns: int
    at: float               # time.monotonic()
    points: int
    median_m: float


class FaultyStack(Stack):
    """Sketcher, reconstructor, recorder, bag recorder and driver.

    Args:
        folder: for recordings, bags, packets.
        own_mounts: whether recordings and shared memory may have disks of their own.
    """

    def __init__(self, folder: Path, own_mounts: bool):
        super().__init__({"sketcher": {"frame_period_s": FRAME_S, "gap_s": GAP_S}})
        self.folder, self.models = folder, sensors()
        self.sensor, self.shift_s = USUAL, 0.0
        self.clouds: list[Seen] = []            # since somebody began to wait for one
        self.misplaced: list[Seen] = []         # that showed what is not there
        self.described: SensorModel | None = None
        self.recorded: list[tuple[str, Path, bool]] = []        # to be looked at: which node's, where, whether whole
        self._paths: dict[str, Path] = {}
        self._made = Counter()
        self._clients: dict[str, tuple] = {}        # and the process that knows each
        shutil.rmtree(folder, ignore_errors=True)
        self.disk_folder = folder / "disk"
        self.disk_folder.mkdir(parents=True)
        self.disk = Disk(self.disk_folder, DISK_MB) if own_mounts else None
        self.shared_memory = Disk(Path("/dev/shm"), SHARED_MEMORY_MB, "1777") if own_mounts else None
        for name, model in self.models.items():
            self._write_packets(folder / "sensors" / name, model)

    def __enter__(self) -> "FaultyStack":
        super().__enter__()
        try:
            node = self.monitor.node
            node.create_subscription(PointCloud2, "points", self._on_cloud, 100, raw=True)
            node.create_subscription(String, "sketch/sensor", self._on_description, LATCHED)
            for name in RECORDERS:
                self.start(name)
            self.start_driver()
        except BaseException:
            self.__exit__()
            raise
        return self

    def close(self) -> None:
        """Give the disks back, after the end."""
        for disk in filter(None, (self.disk, self.shared_memory)):
            disk.unmount()

    def start(self, name: str, wait: bool = True, node: str = "", **parameters) -> Process:
        """As of every stack; a recorder begins another file."""
        if name in RECORDERS:
            self.note_recorded(name)
            self._made[name] += 1
            home = self.disk_folder if name == "recorder" else self.folder
            self._paths[name] = home / f"{self._made[name]:03}.{RECORDERS[name]}"
            parameters["path"] = str(self._paths[name])
        return super().start(name, wait, node, **parameters)

    def note_recorded(self, name: str) -> None:
        """What a recorder that has ended leaves behind is to be looked at; with a full disk it made several files."""
        if path := self._paths.pop(name, None):
            whole = self.processes[name].returncode == 0
            parts = sorted(path.parent.glob(f"{path.stem}*.{RECORDERS[name]}"))
            self.recorded += [(name, part, whole) for part in parts]

    def again(self, name: str) -> None:
        """Start a node or the driver again, which has ended."""
        if name == "driver":
            self.start_driver()
        else:
            self.start(name)

    # ---- The driver

    def start_driver(self) -> None:
        """Start the driver, and have it send."""
        driver = self.run("driver", [str(HERE / "bad_driver.py"), str(self.folder / "sensors")], controlled=True)
        driver.says("ready")
        self.drive(sensor=self.sensor, shift_s=self.shift_s)

    def drive(self, **settings) -> Counter[str]:
        """Have the driver behave otherwise; what it did so far."""
        self.sensor = settings.get("sensor") or self.sensor
        self.shift_s = settings.get("shift_s", self.shift_s)
        driver = self.processes["driver"]
        before = len(driver.lines)
        driver.tell(json.dumps(settings))
        self.wait(lambda: len(driver.lines) > before or not driver.running, "an answer of the driver")
        return Counter(json.loads(driver.lines[-1]))

    def resume(self) -> None:
        """Have a driver that was paused go on."""
        self.drive(sensor=self.sensor)

    def stamp_ns(self) -> int:
        """Of a frame that the driver begins now."""
        return time.time_ns() + round(self.shift_s * 1e9)

    # ---- Clouds

    def new_clouds(self, since_ns: int) -> list[Seen]:
        """Those whose photons all came after a stamp, with as many points as they should have."""
        enough = ENOUGH * self.models[self.sensor].pixels
        return [cloud for cloud in self.clouds      # those far ahead are of a time that has been taken back
                if 0 <= cloud.stamp_ns - since_ns < AHEAD_NS and cloud.points > enough]

    def wait_for_cloud(self, timeout_s: float) -> float:
        """Seconds from now to the arrival of a right cloud of what is only now seen; TimeoutError if none comes."""
        at, since_ns = time.monotonic(), self.stamp_ns()
        self.clouds.clear()
        self.wait(lambda: self.new_clouds(since_ns), "a cloud", timeout_s)
        return self.new_clouds(since_ns)[0].at - at

    def _on_cloud(self, raw: bytes) -> None:
        header, columns = points_message.decode_cdr(raw)
        ranges = np.linalg.norm(columns["xyz"], axis=1)
        median_m = float(np.median(ranges)) if len(ranges) else np.nan
        self.clouds.append(Seen(header.stamp_ns, time.monotonic(), len(ranges), median_m))
        if len(ranges) and abs(median_m - PLANE_M) > NEAR_M:
            self.misplaced.append(self.clouds[-1])

    def _on_description(self, message: String) -> None:
        self.described = sketch_message.decode_sensor(message)[0]

    # ---- Services

    def call(self, service_type: type, service: str, request):
        """The answer of a service. One that asks a node which does not know it yet is never answered."""
        owner = self.processes[service.partition("/")[0]].pid
        client, known_to = self._clients.get(service, (None, None))
        if client is None:
            client = self.monitor.node.create_client(service_type, service)
        self.wait(client.service_is_ready, f"the service {service}")
        if owner != known_to:
            become_known(self.monitor.node, service.partition("/")[0], partial(self.wait, timeout_s=ANSWER_S))
            self.spin(ACQUAINTED_S)         # and this side has to find the service of a node that has come back
            self._clients[service] = client, owner
        future = client.call_async(request)
        self.wait(future.done, f"an answer of {service}", ANSWER_S)
        return future.result()

    def _write_packets(self, folder: Path, model: SensorModel) -> None:
        folder.mkdir(parents=True)
        (folder / "sensor.json").write_text(sensor_message.encode(model).data)
        scene = StaticScene(np.full((model.rows, model.cols), PLANE_M))
        for k in range(PACKETS):
            events, _ = Simulator(scene, model, sbr=SBR, ppp=PPP / PACKETS, seed=k).frame(0)
            (folder / f"{k}.cdr").write_bytes(photons_message.encode_cdr(events, model, model.frame_id))


def inspect(kind: str, path: Path) -> Process:
    """A process that opens what was recorded, as its user would; 0 if it can."""
    looks = {"recorder": ["review", str(path), "--no-report", "--json"],
             "bag_recorder": ["reconstruct", str(path), "-o", f"{path}.npz", "--json"]}[kind]
    return Process([sys.executable, "-m", "srt3d_ros.cli.main", *looks])
