"""Damaged files are read, or refused in one line; tests/files/test_isolated.py has .mat files."""

import io
import zipfile
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from srt3d_ros import datasets
from srt3d_ros.cloud import as_noun
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonHistograms
from srt3d_ros.core.sketching.sums import noise_sketch
from srt3d_ros.datasets import open_sensor, photon_file
from srt3d_ros.datasets.bags.bag import Bag
from srt3d_ros.messages import cdr, photon_frames
from srt3d_ros.messages import sensor_message as sensor
from srt3d_ros.photons import Photons
from srt3d_ros.sketch import Sketch
from tests.bags import CLOUD, TEXT, write_bag
from tests.datasets import laboratory_files
from tests.datasets.made_logs import tmf8829_log, zones_16
from tests.robustness.conftest import read_or_refused
from tests.robustness.test_messages import CODECS, SENSOR

STAMP_NS = 1_700_000_000_000_000_000
EVENTS = PhotonEvents(np.array([0, 3, 5, 5], np.uint32), np.array([49, 0, 7, 8], np.uint16), STAMP_NS)
IRF = [1, 3, 1]


def saved(save, *values) -> bytes:
    """The bytes that a function of NumPy or ptufile writes to a file."""
    file = io.BytesIO()
    save(file, *values)
    return file.getvalue()


def counts() -> np.ndarray:
    """A few photons as counts [rows, cols, bins]."""
    cube = np.zeros((2, 3, 20), np.uint16)
    cube[0, 1, 5], cube[1, 2, 19] = 2, 1
    return cube


def photon_bytes(folder: Path) -> bytes:
    photon_file.save(folder / "made.npz", SENSOR, EVENTS, np.full((3, 4), 7, np.float32))
    return (folder / "made.npz").read_bytes()


def ptu_bytes(folder: Path) -> bytes:
    ptufile = pytest.importorskip("ptufile")
    return saved(ptufile.imwrite, counts()[None, :, :, None], 2e-9, 1e-10)


def sdt_bytes(folder: Path) -> bytes:
    pytest.importorskip("sdtfile")
    return laboratory_files.sdt(folder / "made.sdt", [counts()], 2e-9).read_bytes()


def t2_bytes(folder: Path) -> bytes:
    pytest.importorskip("ptufile")
    records = [1 << 31 | 10, 1 << 25 | 13, 1 << 31 | 30, 1 << 31 | 63 << 25 | 1, 1 << 31 | 50, 2 << 25 | 51]
    tags = {"Measurement_SubMode": 0, "HWSync_Divider": 1}
    return laboratory_files.ptu(folder / "made.ptu", records, laboratory_files.T2, tags).read_bytes()


def phu_bytes(folder: Path) -> bytes:
    pytest.importorskip("ptufile")
    return laboratory_files.phu(folder / "made.phu", [*counts()[0]], 1e-10, 500_000_000).read_bytes()


def hdf5_bytes(folder: Path) -> bytes:
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "made.h5", "w") as file:
        file.create_dataset("scan/counts", data=counts(), chunks=True, compression="gzip")
    return (folder / "made.h5").read_bytes()


def log_bytes(folder: Path) -> bytes:
    return tmf8829_log(folder / "made.json", [zones_16(1.0)]).read_bytes()


# Name of the file, its reader, and what makes an example.
FILES = {
    "npz": ("a.npz", datasets.read, photon_bytes),
    "irf": ("irf.npy", lambda path: datasets.read(path.with_name("made.npz"), irf=path),
            lambda folder: photon_bytes(folder) and saved(np.save, np.array([1, 3, 1.5]))),
    "irf_text": ("irf.csv", lambda path: datasets.read(path.with_name("made.npz"), irf=path, bin_width_s=1e-10),
                 lambda folder: photon_bytes(folder) and b"time_ns,counts\n0.1,1\n0.2,3\n0.3,1.5\n"),
    "sensor_file": ("s.json", open_sensor, lambda folder: CODECS["sensor"][1][0]),
    "npy_counts": ("c.npy", partial(datasets.read, irf=IRF, bin_width_s=1e-10),
                   lambda folder: saved(np.save, counts())),
    "ptu": ("b.ptu", partial(datasets.read, irf=IRF), ptu_bytes),
    "sdt": ("a.sdt", partial(datasets.read, irf=IRF), sdt_bytes),
    "t2": ("t2.ptu", partial(datasets.read, irf=IRF), t2_bytes),
    "phu": ("a.phu", partial(datasets.read, irf=IRF), phu_bytes),
    "irf_phu": ("irf.phu", lambda path: datasets.read(path.with_name("made.npz"), irf=path),
                lambda folder: photon_bytes(folder) and phu_bytes(folder)),
    "irf_export": ("irf.dat", lambda path: datasets.read(path.with_name("made.npz"), irf=path),
                   lambda folder: photon_bytes(folder) and b"#ns/bin\n0.05\t0.05\n#counts\n1\t0\n3\t9\n4\t2\n"),
    "csv": ("a.csv", partial(datasets.read, irf=IRF, bin_width_s=1e-10, rows=2, cols=2, num_bins=40),
            lambda folder: b'"x";"y";"t [ns]"\n1;0;2,5\n0;1;"0,7"\n1;1;1,1\n'),
    "words": ("w.npy", partial(datasets.read, irf=IRF, no_detection=0, first_word=1, num_bins=20),
              lambda folder: saved(np.save, counts())),
    "hdf5": ("a.h5", partial(datasets.read, irf=IRF), hdf5_bytes),
    "tmf8829": ("log.json", datasets.read, log_bytes),
}
IN_A_CHILD = ("hdf5",)        # which takes ten times as long to start as others to read


@pytest.mark.parametrize("kind", FILES)
def test_a_damaged_file_is_read_or_refused_in_one_line(kind, rounds, tmp_path):
    name, read, make = FILES[kind]
    example, path = make(tmp_path), tmp_path / name

    def read_bytes(raw: bytes) -> None:
        path.write_bytes(raw)
        read(path)

    read_or_refused(read_bytes, [example], rounds // 10 if kind in IN_A_CHILD else rounds)


@pytest.mark.parametrize("make", [
    lambda: Photons(SENSOR, EVENTS, np.full((2, 3, 4), 7, np.float32), notes=("a note",)),
    lambda: Photons(SENSOR, PhotonHistograms(np.ones((3, 4, 5), np.float32))),
    lambda: as_noun(Sketch, noise_sketch(SENSOR, (1, 2))),
    lambda: as_noun(Sketch, noise_sketch(SENSOR, (1, 2))).reconstruct()],
    ids=["photons", "counts", "sketch", "cloud"])
def test_a_damaged_array_in_a_saved_file_is_read_or_refused_in_one_line(make, rounds, tmp_path):
    """Arrays whose archive is intact, so that its checksum does not catch the damage."""
    make().save(tmp_path / "made.npz")
    with zipfile.ZipFile(tmp_path / "made.npz") as archive:
        arrays = {name: archive.read(name) for name in archive.namelist()}

    def read(raw: bytes) -> None:
        damaged = list(arrays)[(raw[0] if raw else 0) % len(arrays)]
        with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
            for name, content in arrays.items():
                archive.writestr(name, raw[1:] if name == damaged else content)
        datasets.read(tmp_path / "a.npz")

    read_or_refused(read, [bytes([k]) + content for k, content in enumerate(arrays.values())], rounds)


@pytest.mark.parametrize(("storage", "packed"), [
    ("mcap", ""), ("sqlite3", ""), ("sqlite3", "MESSAGE")])
def test_a_damaged_bag_is_read_or_refused_in_one_line(storage, packed, rounds, tmp_path):
    messages = [("/sensor", TEXT, cdr.write_text(sensor.to_json(SENSOR))),
                ("/photons", CLOUD, photon_frames.PHOTONS.encode_cdr(EVENTS, SENSOR, "spad"))]
    write_bag(tmp_path / "bag", messages, storage, compressed=packed)
    path, = set((tmp_path / "bag").iterdir()) - {tmp_path / "bag/metadata.yaml"}

    def read(raw: bytes) -> None:
        path.write_bytes(raw)
        with Bag(path.parent) as bag:
            list(bag.messages(bag.topics))
        datasets.read(path.parent)

    read_or_refused(read, [path.read_bytes()], rounds)
