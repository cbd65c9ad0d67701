"""Fuzz targets of files: photon files, sensors, bags, recordings."""

import io
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from robustness.targets import Made, Target
from robustness.targets_messages import SENSOR, SENSOR_TEXTS
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.datasets import npz, open_photons, open_sensor, sketch_file
from srt3d_ros.datasets.bag import Bag
from srt3d_ros.datasets.bag_writer import BagWriter, Offer
from srt3d_ros.datasets.scene import read_scene
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import cdr, photons, sensor

STAMP_NS = 1_700_000_000_000_000_000
EVENTS = PhotonEvents(np.array([0, 3, 5, 5], np.uint32), np.array([49, 0, 7, 8], np.uint16), STAMP_NS)
SIDECARS = [b'{"num_bins": 120, "bin_width_s": 2e-10, "irf": [1, 3.5, 1], "irf_ref": 1, "toa_offset_bins": 2}',
            b'{"gate": [5, 40], "fov_deg": 20, "range_offset_m": -1e-3, "rows": 3, "cols": 4}']
REFUSED = re.compile("(?:srt3d: .* repaired into .*\n)?srt3d: error: (.*?) is (.*?): expected (.*)\n")
FOLDERS: list[tempfile.TemporaryDirectory] = []     # they last as long as the process


def own_folder() -> Path:
    FOLDERS.append(tempfile.TemporaryDirectory(prefix="fuzz_"))
    return Path(FOLDERS[-1].name)


def photon_file() -> bytes:
    path = own_folder() / "a.npz"
    npz.save(path, SENSOR, EVENTS, np.full((3, 4), 7, np.float32))
    return path.read_bytes()


def _saved(save: Callable[..., object], *values, **named) -> bytes:
    """What a function of NumPy or scipy writes to a file."""
    file = io.BytesIO()
    save(file, *values, **named)
    return file.getvalue()


def _file(path: str | Path, read: Callable[[Path], object], examples: Callable[[], list[bytes]]) -> Made:
    """The bytes are all of a file, which `read` opens; without a folder it is in one with the photon file a.npz."""
    if not isinstance(path, Path):
        folder = own_folder()
        (folder / "a.npz").write_bytes(photon_file())
        path = folder / path

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


def _sketch_file() -> bytes:
    path, photons_seen = own_folder() / "s.npz", np.arange(12, dtype=np.uint32).reshape(3, 4)
    sketch_file.save(path, Sketch((1, 5), (photons_seen[..., None] * [1j, 0.5]).astype(np.complex64), photons_seen,
                                  STAMP_NS), SENSOR)
    return path.read_bytes()


def _mat_files() -> list[bytes]:
    """Files of the published kinds."""
    from scipy.io import savemat

    cells = np.empty((1, 2), object)
    cells[0, 0], cells[0, 1] = np.array([[12], [15]], np.uint16), np.zeros((0, 0), np.uint16)
    return [_saved(savemat, variables) for variables in (
        {"Ts": cells}, {"Y": np.eye(4, dtype=np.uint8)},
        {"data_processed": cells, "mm": np.int32(0), "MM": np.int32(9_000)})]


def _cube() -> np.ndarray:
    """Counts [rows, cols, bins] of a few photons."""
    counts = np.zeros((2, 3, 20), np.uint16)
    counts[0, 1, 5], counts[1, 2, 19] = 2, 1
    return counts


def _ptu_files() -> list[bytes]:
    """Two frames of a scan, in records of two kinds."""
    import ptufile

    return [_saved(ptufile.imwrite, np.stack([_cube()] * 2), 2e-9, 1e-10, has_frames=True, record_type=kind)
            for kind in (ptufile.PtuRecordType.PicoHarpT3, ptufile.PtuRecordType.GenericT3)]


def _hdf5_files() -> list[bytes]:
    import h5py

    file = io.BytesIO()
    with h5py.File(file, "w") as content:
        content["counts"] = _cube()
    return [file.getvalue()]


def _linospad2_file() -> bytes:
    words = np.zeros((2, 65, 4), np.uint32)
    words[0, 2, :2], words[1, 63, 0] = (2**31 + 5, 2**31 + 2**28 + 999), 2**31 + 7
    return words.tobytes()


def _bag(storage: str, pattern: str) -> Made:
    """The bytes are one of the files of a bag."""
    folder = own_folder() / "bag"
    writer = BagWriter(folder, storage)
    writer.add_topic("/sensor", "std_msgs/msg/String", [Offer(durability="transient_local", depth=1)])
    writer.add_topic("/photons", "sensor_msgs/msg/PointCloud2", [Offer()])
    writer.write("/sensor", STAMP_NS, cdr.write_text(sensor.to_json(SENSOR)))
    writer.write("/photons", STAMP_NS + 1, photons.encode_cdr(EVENTS, SENSOR, "spad"))
    writer.close()
    (path,) = folder.glob(pattern)

    def read(_: Path) -> None:
        with Bag(folder) as bag:
            for _ in bag.messages(bag.topics):
                pass
        open_photons(folder)

    return _file(path, read, lambda: [path.read_bytes()])


def _recordings() -> list[bytes]:
    """A recording, and one without its end, as a killed recorder leaves it."""
    from srt3d_ros.recording.writer import RecordingWriter

    path = own_folder() / "a.rrd"
    with RecordingWriter(path, SENSOR) as writer:
        writer.log_cloud(STAMP_NS, 0, np.ones((3, 3)), np.ones(3))
        writer.log_scalars(STAMP_NS, {"points": 3}, 0)
    whole = path.read_bytes()
    return [whole, whole[:-200]]


def _review(path: Path) -> None:
    """In a process of its own, as rerun may end it."""
    done = subprocess.run([sys.executable, "-m", "srt3d_ros.cli.main", "review", path, "--no-report"],
                          stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if refused := REFUSED.fullmatch(done.stderr):
        raise InvalidInput(*refused.groups())
    if done.returncode:
        raise RuntimeError(f"review ended with {done.returncode}: {done.stderr}")


def _irf(path: Path) -> None:
    open_photons(path.with_name("a.npz"), irf=path)


def _target(name: str, file: str, read, examples: Callable[[], list[bytes]], rounds: int) -> Target:
    return Target(name, partial(_file, file, read, examples), rounds)


TARGETS = (
    _target("npz", "a.npz", open_photons, lambda: [photon_file()], 40_000),
    Target("npz_member", _npz_member, 40_000),
    _target("sidecar", "a.npz.json", lambda path: open_photons(path.with_suffix("")), lambda: SIDECARS, 40_000),
    _target("irf_npy", "b.npy", _irf, lambda: [_saved(np.save, np.array([1, 3, 1.5]))], 30_000),
    _target("irf_text", "b.csv", _irf, lambda: [b"1\n2.5\n1e-1\n# three\n"], 30_000),
    _target("scene", "scene.npz", read_scene, lambda: [_saved(
        np.savez, depth_m=np.linspace(2, 2.5, 12).reshape(3, 4), valid=np.ones((3, 4), bool))], 30_000),
    _target("sketch_file", "s.npz", sketch_file.read, lambda: [_sketch_file()], 40_000),
    _target("sensor_file", "b.json", open_sensor, lambda: SENSOR_TEXTS, 40_000),
    _target("npy_cube", "b.npy", partial(open_photons, irf=[1, 3, 1], bin_width_s=1e-10),
            lambda: [_saved(np.save, _cube())], 20_000),
    _target("npz_cube", "b.npz", partial(open_photons, irf=[1, 3, 1]),
            lambda: [_saved(np.savez, counts=_cube(), bin_width_s=1e-10)], 20_000),
    _target("linospad2", "b.dat", partial(open_photons, irf=[1, 3, 1], num_bins=400), lambda: [_linospad2_file()],
            20_000),
    _target("mat", "b.mat", partial(open_photons, irf=[1, 3, 1]), _mat_files, 2_000),
    Target("bag_mcap", partial(_bag, "mcap", "*.mcap"), 20_000),
    Target("bag_sqlite3", partial(_bag, "sqlite3", "*.db3"), 10_000),
    Target("bag_metadata", partial(_bag, "mcap", "metadata.yaml"), 10_000),
    _target("rrd", "b.rrd", _review, _recordings, 300),
)
# Of files whose reader is an extra.
OPTIONAL = {
    "ptufile": _target("ptu", "b.ptu", partial(open_photons, irf=[1, 3, 1]), _ptu_files, 20_000),
    "h5py": _target("hdf5", "b.h5", partial(open_photons, irf=[1, 3, 1], bin_width_s=1e-10), _hdf5_files, 300),
}
TARGETS += tuple(target for library, target in OPTIONAL.items() if find_spec(library))
