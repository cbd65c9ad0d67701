"""Damaged files are read, or refused in one line; tests/files/test_isolated.py has .mat files."""

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


def counts() -> np.ndarray:
    """A few photons as counts [rows, cols, bins]."""
    cube = np.zeros((2, 3, 20), np.uint16)
    cube[0, 1, 5], cube[1, 2, 19] = 2, 1
    return cube


def as_irf(path: Path) -> None:
    datasets.read(path.with_name("made.npz"), irf=path, bin_width_s=1e-10)


def save_photons(path: Path) -> None:
    photon_file.save(path, SENSOR, EVENTS, np.full((3, 4), 7, np.float32))


def save_phu(path: Path) -> None:
    laboratory_files.phu(path, [*counts()[0]], 1e-10, 500_000_000)


def save_hdf5(path: Path) -> None:
    with pytest.importorskip("h5py").File(path, "w") as file:
        file.create_dataset("scan/counts", data=counts(), chunks=True, compression="gzip")


def texts(content: bytes):
    return lambda path: path.write_bytes(content)


T2_RECORDS = [1 << 31 | 10, 1 << 25 | 13, 1 << 31 | 30, 1 << 31 | 63 << 25 | 1, 1 << 31 | 50, 2 << 25 | 51]
with_irf, with_bins = partial(datasets.read, irf=IRF), partial(datasets.read, irf=IRF, bin_width_s=1e-10)
# Name of the file, its reader, what writes an example, and the library that may be missing.
FILES = {
    "npz": ("a.npz", datasets.read, save_photons), "irf": ("irf.npy", as_irf, partial(np.save, arr=[1, 3, 1.5])),
    "irf_text": ("irf.csv", as_irf, texts(b"time_ns,counts\n0.1,1\n0.2,3\n0.3,1.5\n")),
    "irf_phu": ("irf.phu", as_irf, save_phu, "ptufile"),
    "irf_export": ("irf.dat", as_irf, texts(b"#ns/bin\n0.05\t0.05\n#counts\n1\t0\n3\t9\n4\t2\n")),
    "sensor_file": ("s.json", open_sensor, texts(CODECS["sensor"][1][0])),
    "npy_counts": ("c.npy", with_bins, partial(np.save, arr=counts())),
    "ptu": ("b.ptu", with_irf, lambda path: pytest.importorskip("ptufile").imwrite(
        path, counts()[None, :, :, None], 2e-9, 1e-10)),
    "sdt": ("a.sdt", with_irf, lambda path: laboratory_files.sdt(path, [counts()], 2e-9), "sdtfile"),
    "t2": ("t2.ptu", with_irf, lambda path: laboratory_files.ptu(path, T2_RECORDS, laboratory_files.T2, {
        "Measurement_SubMode": 0, "HWSync_Divider": 1}), "ptufile"),
    "phu": ("a.phu", with_irf, save_phu, "ptufile"),
    "csv": ("a.csv", partial(with_bins, rows=2, cols=2, num_bins=40),
            texts(b'"x";"y";"t [ns]"\n1;0;2,5\n0;1;"0,7"\n1;1;1,1\n')),
    "words": ("w.npy", partial(with_irf, no_detection=0, first_word=1, num_bins=20), partial(np.save, arr=counts())),
    "hdf5": ("a.h5", with_irf, save_hdf5),
    "tmf8829": ("log.json", datasets.read, lambda path: tmf8829_log(path, [zones_16(1.0)])),
}
IN_A_CHILD = ("hdf5",)        # which takes ten times as long to start as others to read


@pytest.mark.parametrize("kind", FILES)
def test_a_damaged_file_is_read_or_refused_in_one_line(kind, rounds, tmp_path):
    name, read, make, *libraries = FILES[kind]
    for library in libraries:
        pytest.importorskip(library)
    path = tmp_path / name
    save_photons(tmp_path / "made.npz")
    make(path)

    def read_bytes(raw: bytes) -> None:
        path.write_bytes(raw)
        read(path)

    read_or_refused(read_bytes, [path.read_bytes()], rounds // 10 if kind in IN_A_CHILD else rounds)


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
