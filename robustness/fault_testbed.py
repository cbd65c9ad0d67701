"""FaultTestbed: the pipeline with recorders, its own disks and a driver that can misbehave."""

import contextlib
import json
import os
import shutil
import subprocess
import sys
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
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.processes import Process

OWN_MOUNTS = "SRT3D_ROBUSTNESS_MOUNTS"      # in the environment of a process that has a mount namespace
DISK_MB, SHARED_MEMORY_MB = 256, 320
PLANE_M, PPP, SBR, PACKETS = 3.0, 20.0, 4.0, 4
NEAR_M = 0.06               # of a median of hundreds of points from the plane: bins are up to 3 cm
ENOUGH = 0.9                # of the pixels have a point
AHEAD_NS = 60 * 10**9
SUFFIX = {"recorder": ".rrd", "bag_recorder": ".bag"}
IRF = np.exp(-0.5 * (np.arange(15) - 7) ** 2 / 4)
USUAL = SensorModel(24, 32, 300, 1e-10, IRF, frame_id="spad", projection=Pinhole.from_fov(24, 32, 20.0))
SENSORS = {"usual": USUAL, "size": USUAL.replace(rows=33, cols=20, projection=Pinhole.from_fov(33, 20, 20.0)),
           "T": USUAL.replace(num_bins=170, bin_width_s=2e-10),
           "IRF": USUAL.replace(irf=np.array([0.5, 1.0, 0.8, 0.4, 0.2, 0.1]), irf_ref=1)}


class Disk:
    """A file system in memory, mounted on a folder."""

    def __init__(self, folder: Path, size_mb: int, mode: str = "0755"):
        self.folder, self._filler = folder, folder / "filler"
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size_mb}m,mode={mode}", "robustness", folder], check=True)

    @property
    def free_bytes(self) -> int:
        room = os.statvfs(self.folder)
        return room.f_bavail * room.f_frsize

    def fill(self) -> None:
        """Leave no room."""
        with open(self._filler, "ab") as file:
            while size := self.free_bytes:
                with contextlib.suppress(OSError):      # somebody else took it meanwhile
                    os.posix_fallocate(file.fileno(), file.seek(0, os.SEEK_END), size)

    def empty(self) -> None:
        self._filler.unlink(missing_ok=True)

    def remount(self, option: str) -> None:
        """`ro` or `rw`."""
        subprocess.run(["mount", "-o", f"remount,{option}", self.folder], check=True)


def enter_own_mounts() -> bool:
    """Go on in a mount namespace, which nobody else sees; False where neither root nor user namespaces allow it."""
    unshare = ["unshare", "--mount", "--propagation", "private"]
    for way in (unshare, [*unshare, "--user", "--map-root-user"]) if OWN_MOUNTS not in os.environ else ():
        with contextlib.suppress(OSError):
            if subprocess.run([*way, "mount", "-t", "tmpfs", "none", "/mnt"], capture_output=True).returncode == 0:
                os.environ[OWN_MOUNTS] = "1"
                os.execvp(way[0], [*way, sys.executable, "-m", "robustness", *sys.argv[1:]])
    return OWN_MOUNTS in os.environ


class FaultTestbed(Testbed):
    """Sketcher, reconstructor, recorder, bag recorder and driver.

    Args:
        folder: for recordings, bags and packets.
        own_mounts: whether recordings and shared memory may have disks of their own.

    Attributes:
        clouds: stamp and number of points of those that came since somebody began to wait for one.
        misplaced: median ranges of clouds that show a surface where there is none.
        recorded: finished recordings and bags to check: of which node, where, whether it ended in order.
    """

    def __init__(self, folder: Path, own_mounts: bool):
        self.folder, self.sensor, self._shift_s = folder, "usual", 0.0
        self._recorded = {"recorder": folder / "disk", "bag_recorder": folder}
        super().__init__({name: self._path(name, 0) for name in SUFFIX} | {
            "reconstructor": {}, "sketcher": {"frame_period_s": 0.1, "gap_s": 1.0}})
        self.clouds: list[tuple[int, int]] = []
        self.misplaced: list[float] = []
        self.recorded: list[tuple[str, Path, bool]] = []
        shutil.rmtree(folder, ignore_errors=True)
        (folder / "disk").mkdir(parents=True)
        self.disk = Disk(folder / "disk", DISK_MB) if own_mounts else None
        self.shared_memory = Disk(Path("/dev/shm"), SHARED_MEMORY_MB, "1777") if own_mounts else None
        for name, sensor in SENSORS.items():
            _write_packets(folder / "sensors" / name, sensor)

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
        if name != "driver":
            path = self._path(name, self._number(name) + 1) if name in SUFFIX else {}
            return super().start(name, *ros_args, **parameters, **path)
        command = [sys.executable, str(Path(__file__).with_name("driver.py")), str(self.folder / "sensors")]
        self.run("driver", command, stdin=subprocess.PIPE).ready()
        self.drive(sensor=self.sensor, shift_s=self._shift_s)
        return self["driver"]

    def remove(self, name: str) -> None:
        if name in SUFFIX:
            self._note_recorded(name)
        super().remove(name)

    def drive(self, **settings) -> Counter[str]:
        """Have the driver behave like this (see driver.py); what it did so far."""
        self.sensor, self._shift_s = settings.get("sensor") or self.sensor, settings.get("shift_s", self._shift_s)
        driver = self["driver"]
        before = len(driver.lines)
        driver.tell(json.dumps(settings))
        self.wait(lambda: len(driver.lines) > before or not driver.running, "an answer of the driver")
        return Counter(json.loads(driver.lines[-1]))

    def stamp_ns(self) -> int:
        """Of a frame that the driver begins now."""
        return time.time_ns() + round(self._shift_s * 1e9)

    def wait_for_cloud(self, timeout_s: float) -> float:
        """Seconds until a cloud of photons from now on comes, with as many points as it should have."""
        began_s, since_ns, enough = time.monotonic(), self.stamp_ns(), ENOUGH * SENSORS[self.sensor].pixels
        self.clouds.clear()
        # Those far ahead are of a time that has been taken back.
        self.wait(lambda: any(0 <= stamp_ns - since_ns < AHEAD_NS and points > enough
                              for stamp_ns, points in self.clouds), "a cloud", timeout_s)
        return time.monotonic() - began_s

    def _number(self, name: str) -> int:
        """How many processes a node had before this one."""
        return sum(name == other for other, _ in self.replaced)

    def _path(self, name: str, number: int) -> dict[str, str]:
        return {"path": str(self._recorded[name] / f"{number:03}{SUFFIX[name]}")}

    def _note_recorded(self, name: str) -> None:
        """All files of the node's last process: after an error it begins another."""
        parts = sorted(self._recorded[name].glob(f"{self._number(name):03}*{SUFFIX[name]}"))
        self.recorded += [(name, part, self[name].returncode == 0) for part in parts]

    def _on_cloud(self, raw: bytes) -> None:
        header, columns = points_message.decode_cdr(raw)
        ranges = np.linalg.norm(columns["xyz"], axis=1)
        median_m = float(np.median(ranges)) if len(ranges) else PLANE_M
        self.clouds.append((header.stamp_ns, len(ranges)))
        if abs(median_m - PLANE_M) > NEAR_M:
            self.misplaced.append(median_m)


def _write_packets(folder: Path, sensor: SensorModel) -> None:
    folder.mkdir(parents=True)
    (folder / "sensor.json").write_text(sensor_message.encode(sensor).data)
    scene = StaticScene(np.full((sensor.rows, sensor.cols), PLANE_M))
    for k in range(PACKETS):
        events, _ = Simulator(scene, sensor, sbr=SBR, ppp=PPP / PACKETS, seed=k).frame(0)
        (folder / f"{k}.cdr").write_bytes(photons_message.encode_cdr(events, sensor, sensor.frame_id))
