"""Files of a gigabyte, and what says it is larger than any memory: refused before room is made for it."""

import gzip
import os
import struct
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec

import pytest

ZSTD = "compression.zstd" if find_spec("compression") else "backports.zstd"
LIMITED = """
import resource, sys
from pathlib import Path
from srt3d_ros import read
from srt3d_ros.datasets import open_sensor
from srt3d_ros.errors import InvalidInput
import lz4.frame, rosbags.rosbag2, scipy.io
used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 600 * 2**20,) * 2)
for path in sys.argv[1:]:
    try:
        (open_sensor if path.endswith(".json") else read)(path)
        print("read", path)
    except InvalidInput as error:
        print(error)
"""
# Of each file what it begins with, what is said of it, and the library that reads it if that may be missing.
GIGABYTES = {
    "a.json": (b"[", "a.json is 1073741824 bytes: expected at most", ""),
    "b.npz": (b"PK\3\4", "b.npz is unreadable", ""),
    "c.mat": (b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM", "c.mat is unreadable", ""),
    "d.mcap": (b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, 2**30 - 17),
               "bag d.mcap has no topics of photons. It has no messages; d.mcap was cut off", ""),
    "e.db3": (b"SQLite format 3\0", "bag e.db3 is unreadable", ""),
    "g.npy": (b"", "g.npy counts is unreadable", ""),
    "i.ptu": (b"PQTTTR\0\0001.0.00\0\0", "i.ptu is unreadable", "ptufile")}

def mcap(size: int) -> bytes:
    """An .mcap file of one chunk that says that it unpacks to `size` bytes, and has 0.5 GB; without a summary."""
    mark, packed = b"\x89MCAP0\r\n", import_module(ZSTD).compress(bytes(2**29))
    chunk = struct.pack("<QQQII4sQ", 0, 0, size, 0, 4, b"zstd", len(packed)) + packed
    records = ((1, b"\4\0\0\0ros2\0\0\0\0"), (6, chunk), (2, bytes(20)))
    return mark + b"".join(struct.pack("<BQ", kind, len(content)) + content for kind, content in records) + mark


# Of each file what is in it, and what is said of it.
SMALL = {
    "lists.json.gz": (lambda: gzip.compress(b'{"Result_Set":[' + b"[]," * 2**23 + b"[]]}", 1),
                      "lists.json.gz: The log has more than 1048576 lists and objects: split it"),
    "spaces.json.gz": (lambda: gzip.compress(b" " * 2**28, 1), "spaces.json.gz: The log has more than 201326592 bytes"),
    "zstd.mcap": (lambda: mcap(2**29), "bag zstd.mcap is unreadable (a chunk has 536870912 bytes, more"),
    "lies.mcap": (lambda: mcap(100), "bag lies.mcap is unreadable (Chunk size mismatch: expected 100 bytes")}


@pytest.fixture(scope="module")
def said(tmp_path_factory) -> dict[str, str]:
    """What a process that may take 600 MB says of each file."""
    folder = tmp_path_factory.mktemp("files")
    for name, (begin, _, library) in GIGABYTES.items():
        if not library or find_spec(library):
            (folder / name).write_bytes(begin)
            os.truncate(folder / name, 2**30)
    for name, (content, _) in SMALL.items():
        (folder / name).write_bytes(content() if callable(content) else content.encode())
    paths = sorted(folder.iterdir())
    done = subprocess.run([sys.executable, "-c", LIMITED, *paths], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return dict(zip([path.name for path in paths], done.stdout.splitlines(), strict=True))


@pytest.mark.parametrize("name", [*GIGABYTES, *SMALL])
def test_a_file_that_takes_gigabytes_is_refused_in_one_line(said, name):
    line, expected = said.get(name), (GIGABYTES | SMALL)[name][1]
    if line is None:
        pytest.skip("its reader is not installed")
    assert line.startswith(expected) and "Unable to allocate" not in line and "MemoryError" not in line
