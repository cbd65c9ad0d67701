"""Fuzz targets of files: photon files, sensors, bags, recordings."""

import io
import re
import struct
import subprocess
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

import numpy as np

from robustness.targets import Made, Target
from robustness.targets_messages import SENSOR_TEXTS
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets import npz, open_photons, open_sensor
from srt3d_ros.datasets.bag import Bag
from srt3d_ros.datasets.bag_writer import BagWriter, Offer
from srt3d_ros.datasets.scene import read_scene
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import cdr, photons, sensor

STAMP_NS = 1_700_000_000_000_000_000
SENSOR = SensorModel(2, 3, 50, 1e-10, [1, 2, 1], mask=np.ones((2, 3), bool), frame_id="spad")
EVENTS = PhotonEvents(np.array([0, 3, 5, 5], np.uint32), np.array([49, 0, 7, 8], np.uint16), STAMP_NS)
IRF_SUFFIXES = (".npy", ".csv", ".txt")
MAT_HEADER = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
MAT_COMPRESSED = 15         # MATLAB's type code
RRD_HEADER_BYTES, RRD_CONTENTS = 12, (1, 2, 3)      # of a recording: kinds of messages before the footer
REFUSED = re.compile("(?:srt3d: .* repaired into .*\n)?srt3d: error: (.*?) is (.*?): expected (.*)\n")
FOLDERS: list[tempfile.TemporaryDirectory] = []     # they last as long as the process


def own_folder() -> Path:
    FOLDERS.append(tempfile.TemporaryDirectory(prefix="fuzz_"))
    return Path(FOLDERS[-1].name)


def photon_file() -> bytes:
    path = own_folder() / "a.npz"
    npz.save(path, SENSOR, EVENTS, np.full((2, 3), 7, np.float32))
    return path.read_bytes()


def _whole_file(name: str, read: Callable[[Path], object], examples: Callable[[], Iterable[bytes]]) -> Made:
    """The bytes are all of a file."""
    path = own_folder() / name

    def read_bytes(raw: bytes) -> None:
        path.write_bytes(raw)
        read(path)

    return read_bytes, examples()


def _npz_member() -> Made:
    """The first byte chooses the array, the rest is its .npy file, which the archive's checksum does not protect."""
    with zipfile.ZipFile(io.BytesIO(photon_file())) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    path = own_folder() / "a.npz"

    def read(raw: bytes) -> None:
        chosen = list(members)[(raw[0] if raw else 0) % len(members)]
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in members.items():
                archive.writestr(name, raw[1:] if name == chosen else content)
        open_photons(path)

    return read, [bytes([k]) + content for k, content in enumerate(members.values())]


def _sidecar() -> Made:
    path = own_folder() / "a.npz"
    path.write_bytes(photon_file())
    np.save(path.with_name("response.npy"), np.array([1, 3, 1.5]))

    def read(raw: bytes) -> None:
        path.with_name("a.npz.json").write_bytes(raw)
        open_photons(path)

    return read, [b'{"num_bins": 60, "bin_width_s": 2e-10, "irf": [1, 3.5, 1], "irf_ref": 1, "toa_offset_bins": 2}',
                  b'{"gate": [5, 40], "fov_deg": 20, "range_offset_m": -1e-3, "rows": 2, "cols": 3}',
                  b'{"irf": "response.npy"}']


def _irf() -> Made:
    """The first byte chooses the kind of file, the rest is the file."""
    path = own_folder() / "a.npz"
    path.write_bytes(photon_file())

    def read(raw: bytes) -> None:
        response = path.with_suffix(IRF_SUFFIXES[(raw[0] if raw else 0) % len(IRF_SUFFIXES)])
        response.write_bytes(raw[1:])
        open_photons(path, irf=response)

    saved = io.BytesIO()
    np.save(saved, np.array([1, 3, 1.5]))
    return read, [b"\0" + saved.getvalue(), *(kind + b"1\n2.5\n1e-1\n# three\n" for kind in (b"\1", b"\2"))]


def _scene_examples() -> list[bytes]:
    saved = io.BytesIO()
    np.savez(saved, depth_m=np.linspace(2, 2.5, 12).reshape(3, 4), valid=np.ones((3, 4), bool))
    return [saved.getvalue()]


def _mat_variables() -> list[bytes]:
    """Uncompressed variables of the published kinds."""
    from scipy.io import savemat

    cells = np.empty((1, 2), object)
    cells[0, 0], cells[0, 1] = np.array([[12], [15]], np.uint16), np.zeros((0, 0), np.uint16)
    saved = []
    for variables in ({"Ts": cells}, {"Y": np.eye(4, dtype=np.uint8)},
                      {"data_processed": cells, "mm": np.int32(0), "MM": np.int32(9_000)}):
        file = io.BytesIO()
        savemat(file, variables)
        saved.append(file.getvalue()[len(MAT_HEADER):])
    return saved


def _mat(compressed: bool) -> Made:
    """The bytes are variables; compressed, one that stands behind a right checksum."""
    path = own_folder() / "a.mat"

    def read(raw: bytes) -> None:
        if compressed:
            packed = zlib.compress(raw, 1)
            raw = struct.pack("<II", MAT_COMPRESSED, len(packed)) + packed
        path.write_bytes(MAT_HEADER + raw)
        open_photons(path, irf=[1, 3, 1])

    return read, _mat_variables()[:2 if compressed else 3]


def _bag(storage: str) -> Path:
    path = own_folder() / "bag"
    writer = BagWriter(path, storage)
    writer.add_topic("/sensor", "std_msgs/msg/String", [Offer(durability="transient_local", depth=1)])
    writer.add_topic("/photons", "sensor_msgs/msg/PointCloud2", [Offer()])
    writer.write("/sensor", STAMP_NS, cdr.write_text(sensor.to_json(SENSOR)))
    writer.write("/photons", STAMP_NS + 1, photons.encode_cdr(EVENTS, SENSOR, "spad"))
    writer.close()
    return path


def _read_bag(path: Path) -> None:
    with Bag(path) as bag:
        for _ in bag.messages(bag.topics):
            pass
    open_photons(path)


def _bag_storage(storage: str, suffix: str) -> Made:
    (example,) = _bag(storage).glob(f"*{suffix}")
    return _whole_file(f"a{suffix}", _read_bag, lambda: [example.read_bytes()])


def _bag_metadata() -> Made:
    """The bytes are metadata.yaml beside a good storage file."""
    path = _bag("mcap")
    metadata = path / "metadata.yaml"
    example = metadata.read_bytes()

    def read(raw: bytes) -> None:
        metadata.write_bytes(raw)
        _read_bag(path)

    return read, [example]


def recording(finished: bool = True) -> bytes:
    """A recording; unfinished, it lacks its index, as a killed recorder leaves it."""
    from srt3d_ros.recording.writer import RecordingWriter

    path = own_folder() / "a.rrd"
    with RecordingWriter(path, SENSOR) as writer:
        writer.log_cloud(STAMP_NS, 0, np.ones((3, 3)), np.ones(3))
        writer.log_scalars(STAMP_NS, {"points": 3}, 0)
    whole, end = path.read_bytes(), RRD_HEADER_BYTES
    if finished:
        return whole
    while (tag := struct.unpack_from("<QQ", whole, end))[0] in RRD_CONTENTS:
        end += 16 + tag[1]
    return whole[:end]


def _review(path: Path) -> None:
    """In a process of its own, as rerun may end it."""
    done = subprocess.run([sys.executable, "-m", "srt3d_ros.cli.main", "review", path, "--no-report"],
                          stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if refused := REFUSED.fullmatch(done.stderr):
        raise InvalidInput(*refused.groups())
    if done.returncode:
        raise RuntimeError(f"review ended with {done.returncode}: {done.stderr}")


def _repair(path: Path) -> None:
    from srt3d_ros.recording.repair import examine, repair

    state = examine(path)
    if not state.is_finished:
        repair(state)


TARGETS = (
    Target("npz", partial(_whole_file, "a.npz", open_photons, lambda: [photon_file()]), 40_000),
    Target("npz_member", _npz_member, 40_000), Target("sidecar", _sidecar, 40_000), Target("irf", _irf, 60_000),
    Target("scene", partial(_whole_file, "scene.npz", read_scene, _scene_examples), 30_000),
    Target("sensor_file", partial(_whole_file, "a.json", open_sensor, lambda: SENSOR_TEXTS), 40_000),
    Target("mat", partial(_mat, False), 1_000), Target("mat_compressed", partial(_mat, True), 1_000),
    Target("bag_mcap", partial(_bag_storage, "mcap", ".mcap"), 20_000),
    Target("bag_sqlite3", partial(_bag_storage, "sqlite3", ".db3"), 10_000),
    Target("bag_metadata", _bag_metadata, 10_000),
    Target("rrd", partial(_whole_file, "a.rrd", _review, lambda: [recording(), recording(False)]), 300),
    Target("rrd_repair", partial(_whole_file, "a.rrd", _repair, lambda: [recording(False)]), 100),
)
