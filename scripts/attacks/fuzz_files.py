"""The doors of files: photon files, sensors, bags, recordings."""

import io
import re
import struct
import subprocess
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from fuzz_doors import Door
from fuzz_messages import sensor_texts

from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets import npz, open_photons, open_sensor
from srt3d_ros.datasets.bag import Bag
from srt3d_ros.datasets.bag_writer import BagWriter, Offer
from srt3d_ros.datasets.scene import read_scene
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import cdr, photons, sensor

STAMP_NS = 1_700_000_000_000_000_000
MAT_HEADER = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
RRD_HEADER_BYTES, RRD_CONTENTS = 12, (1, 2, 3)      # of a recording: kinds of messages before the footer
COMPRESSED = 15             # MATLAB's type code
REFUSED = re.compile("(?:srt3d: .* repaired into .*\n)?srt3d: error: (.*?) is (.*?): expected (.*)\n")


def own_folder() -> Path:
    """One that lasts as long as the process."""
    kept = tempfile.TemporaryDirectory(prefix="fuzz_")
    _FOLDERS.append(kept)
    return Path(kept.name)


_FOLDERS: list[tempfile.TemporaryDirectory] = []


def _of_file(name: str, read: Callable[[Path], object], examples: Iterable[bytes]):
    """The bytes are all of a file."""
    path = own_folder() / name

    def of_bytes(raw: bytes) -> None:
        path.write_bytes(raw)
        read(path)

    return of_bytes, examples


def photon_file() -> tuple[SensorModel, PhotonEvents, bytes]:
    described = SensorModel(2, 3, 50, 1e-10, [1, 2, 1], mask=np.ones((2, 3), bool), frame_id="spad")
    events = PhotonEvents(np.array([0, 3, 5, 5], np.uint32), np.array([49, 0, 7, 8], np.uint16), STAMP_NS)
    path = own_folder() / "a.npz"
    npz.save(path, described, events, np.full((2, 3), 7, np.float32))
    return described, events, path.read_bytes()


def _npz():
    return _of_file("a.npz", open_photons, [photon_file()[2]])


def _members() -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(photon_file()[2])) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def _npz_member():
    """The first byte chooses the array, the rest is its .npy file: what no checksum of the archive keeps out."""
    members = _members()
    path = own_folder() / "a.npz"

    def read(raw: bytes) -> None:
        chosen = list(members)[(raw[0] if raw else 0) % len(members)]
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in members.items():
                archive.writestr(name, raw[1:] if name == chosen else content)
        open_photons(path)

    return read, [bytes([k]) + content for k, content in enumerate(members.values())]


def _sidecar():
    path = own_folder() / "a.npz"
    path.write_bytes(photon_file()[2])
    np.save(path.with_name("response.npy"), np.array([1, 3, 1.5]))

    def read(raw: bytes) -> None:
        path.with_name("a.npz.json").write_bytes(raw)
        open_photons(path)

    return read, [b'{"num_bins": 60, "bin_width_s": 2e-10, "irf": [1, 3.5, 1], "irf_ref": 1, "toa_offset_bins": 2}',
                  b'{"gate": [5, 40], "fov_deg": 20, "range_offset_m": -1e-3, "rows": 2, "cols": 3}',
                  b'{"irf": "response.npy"}']


def _irf_file(suffix: str):
    def make():
        folder = own_folder()
        path = folder / "a.npz"
        path.write_bytes(photon_file()[2])

        def read(raw: bytes) -> None:
            (folder / f"response{suffix}").write_bytes(raw)
            open_photons(path, irf=folder / f"response{suffix}")

        saved = io.BytesIO()
        np.save(saved, np.array([1, 3, 1.5]))
        return read, [saved.getvalue() if suffix == ".npy" else b"1\n2.5\n1e-1\n# three\n"]

    return make


def _scene():
    saved = io.BytesIO()
    np.savez(saved, depth_m=np.linspace(2, 2.5, 12).reshape(3, 4), valid=np.ones((3, 4), bool))
    return _of_file("scene.npz", read_scene, [saved.getvalue()])


def _sensor_file():
    return _of_file("a.json", open_sensor, sensor_texts())


def _mat_matrices() -> list[bytes]:
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


def _open_mat(path: Path) -> None:       # scipy reads it in a process of its own
    open_photons(path, irf=[1, 3, 1])


def _mat():
    return _of_file("a.mat", _open_mat, [MAT_HEADER + matrix for matrix in _mat_matrices()])


def _mat_compressed():
    """The bytes are what is compressed, behind a right checksum."""
    path = own_folder() / "a.mat"

    def read(raw: bytes) -> None:
        packed = zlib.compress(raw, 1)
        path.write_bytes(MAT_HEADER + struct.pack("<II", COMPRESSED, len(packed)) + packed)
        _open_mat(path)

    return read, _mat_matrices()[:2]        # those of one variable


def _bag(storage: str) -> Path:
    described, events, _ = photon_file()
    path = own_folder() / "bag"
    writer = BagWriter(path, storage)
    writer.add_topic("/sensor", "std_msgs/msg/String", [Offer(durability="transient_local", depth=1)])
    writer.add_topic("/photons", "sensor_msgs/msg/PointCloud2", [Offer()])
    writer.write("/sensor", STAMP_NS, cdr.write_text(sensor.to_json(described)))
    writer.write("/photons", STAMP_NS + 1, photons.encode_cdr(events, described, "spad"))
    writer.close()
    return path


def _read_bag(path: Path) -> None:
    with Bag(path) as bag:
        for _ in bag.messages(bag.topics):
            pass
    open_photons(path)


def _bag_file(storage: str, suffix: str):
    def make():
        (example,) = _bag(storage).glob(f"*{suffix}")
        return _of_file(f"a{suffix}", _read_bag, [example.read_bytes()])

    return make


def _bag_metadata():
    """The bytes are metadata.yaml beside a good storage file."""
    path = _bag("mcap")
    metadata = path / "metadata.yaml"
    example = metadata.read_bytes()

    def read(raw: bytes) -> None:
        metadata.write_bytes(raw)
        _read_bag(path)

    return read, [example]


def recording() -> bytes:
    from srt3d_ros.recording.writer import RecordingWriter

    described, _, _ = photon_file()
    path = own_folder() / "a.rrd"
    with RecordingWriter(path, described) as writer:
        writer.log_cloud(STAMP_NS, 0, np.ones((3, 3)), np.ones(3))
        writer.log_scalars(STAMP_NS, {"points": 3}, 0)
    return path.read_bytes()


def _unfinished(whole: bytes) -> bytes:
    """A recording without its index, as a killed recorder leaves it."""
    end = RRD_HEADER_BYTES
    while (tag := struct.unpack_from("<QQ", whole, end))[0] in RRD_CONTENTS:
        end += 16 + tag[1]
    return whole[:end]


def _rrd():
    def read(path: Path) -> None:       # in a process of its own: rerun may end it
        done = subprocess.run([sys.executable, "-m", "srt3d_ros.cli.main", "review", path, "--no-report"],
                              stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        if refused := REFUSED.fullmatch(done.stderr):
            raise InvalidInput(*refused.groups())
        if done.returncode:
            raise RuntimeError(f"review ended with {done.returncode}: {done.stderr}")

    whole = recording()
    return _of_file("a.rrd", read, [whole, _unfinished(whole)])


def _rrd_repair():
    from srt3d_ros.recording.repair import examine, repair

    def read(path: Path) -> None:
        state = examine(path)
        if not state.is_finished:
            repair(state)

    return _of_file("a.rrd", read, [_unfinished(recording())])


DOORS = (
    Door("npz", _npz, 40_000), Door("npz_member", _npz_member, 40_000), Door("sidecar", _sidecar, 40_000),
    Door("irf_npy", _irf_file(".npy"), 30_000), Door("irf_csv", _irf_file(".csv"), 20_000),
    Door("irf_txt", _irf_file(".txt"), 20_000), Door("scene", _scene, 30_000),
    Door("sensor_file", _sensor_file, 40_000),
    Door("mat", _mat, 1_000), Door("mat_compressed", _mat_compressed, 1_000),
    Door("bag_mcap", _bag_file("mcap", ".mcap"), 20_000), Door("bag_sqlite3", _bag_file("sqlite3", ".db3"), 10_000),
    Door("bag_metadata", _bag_metadata, 10_000), Door("rrd", _rrd, 300), Door("rrd_repair", _rrd_repair, 100),
)
