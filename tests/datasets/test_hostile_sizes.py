"""Files of a gigabyte, and what says it is larger than any memory: refused before room is made for it."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

GIGABYTE = 2**30
LIMITED = """
import resource, sys
from pathlib import Path
from srt3d_ros.datasets import open_photons
from srt3d_ros.datasets import open_sensor
from srt3d_ros.errors import InvalidInput
import lz4.frame, rosbags.rosbag2, scipy.io
used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 300 * 2**20,) * 2)
for path in sys.argv[1:]:
    try:
        (open_sensor if path.endswith(".json") else open_photons)(path)
        print("read", path)
    except InvalidInput as error:
        print(error)
"""
BEGINNINGS = {"a.json": b"[", "b.npz": b"PK\3\4", "c.mat": b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM",
              "d.mcap": b"\x89MCAP0\r\n", "e.db3": b"SQLite format 3\0", "f.npz": b"", "f.npz.json": b"{"}
# Of laboratory files: what begins the file, and the library that reads it.
LABORATORY = {"g.npy": (b"", ""), "h.dat": (b"\xff", ""), "i.ptu": (b"PQTTTR\0\0001.0.00\0\0", "ptufile"),
              "j.phu": (b"PQHISTO\0001.0.00\0\0", "ptufile"), "k.sdt": (b"\x8f\x02", "sdtfile"),
              "l.h5": (b"\x89HDF\r\n\x1a\n", "h5py"), "m.mat": (b"MATLAB 7.3 MAT-file", "h5py")}
BEGINNINGS |= {name: begin for name, (begin, library) in LABORATORY.items() if not library or find_spec(library)}
SENSORS = {"pixels": '{"schema_version":1,"rows":65535,"cols":65535,"num_bins":50,"bin_width_s":1e-9,"irf":[1]}',
           "array": '{"schema_version":1,"rows":2,"cols":2,"num_bins":50,"bin_width_s":1e-9,"irf":{"dtype":"float32",'
                    '"shape":[4294967295,4294967295],"base64":""}}'}


@pytest.fixture(scope="module")
def refusals(tmp_path_factory) -> dict[str, str]:
    """What a process that may take 300 MB says of each file."""
    folder = tmp_path_factory.mktemp("hostile")
    for name, begin in BEGINNINGS.items():
        (folder / name).write_bytes(begin)
        os.truncate(folder / name, GIGABYTE)
    for name, text in SENSORS.items():
        (folder / f"{name}.json").write_text(text)
    paths = [str(path) for path in sorted(folder.iterdir()) if path.name != "f.npz.json"]
    done = subprocess.run([sys.executable, "-c", LIMITED, *paths], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return dict(zip((Path(path).name for path in paths), done.stdout.splitlines(), strict=True))


@pytest.mark.parametrize(("name", "said"), [
    ("a.json", "a.json is 1073741824 bytes: expected at most"),
    ("b.npz", "b.npz is truncated or damaged"),
    ("c.mat", "c.mat is unreadable"), ("d.mcap", "bag d.mcap is unreadable"), ("e.db3", "bag e.db3 is unreadable"),
    ("f.npz", "f.npz.json is 1073741824 bytes: expected at most"),
    ("pixels.json", "pixels.json rows × cols is 65535 × 65535: expected at most"),
    ("array.json", "array.json irf.base64 is 0 bytes: expected 18446744065119617025 numbers")])
def test_a_process_of_little_memory_refuses_it_in_one_line(refusals, name, said):
    assert refusals[name].startswith(said)
    assert "Unable to allocate" not in refusals[name] and "MemoryError" not in refusals[name]


@pytest.mark.parametrize(("name", "said"), [
    ("g.npy", "g.npy counts is unreadable"), ("h.dat", "num_bins is missing"), ("i.ptu", "i.ptu is unreadable"),
    ("j.phu", "j.phu is unreadable"), ("k.sdt", "k.sdt is unreadable"), ("l.h5", "l.h5 is unreadable"),
    ("m.mat", "m.mat is unreadable")])
def test_so_it_does_laboratory_files(refusals, name, said):
    if name not in refusals:
        pytest.skip(f"{LABORATORY[name][1]} is not installed")
    assert refusals[name].startswith(said) and "Unable to allocate" not in refusals[name]
