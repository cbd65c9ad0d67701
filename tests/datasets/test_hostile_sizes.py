"""Files of a gigabyte, and what says it is larger than any memory: refused before room is made for it."""

import os
import subprocess
import sys
from importlib.util import find_spec

LIMITED = """
import resource, sys
from pathlib import Path
from srt3d_ros.datasets import read, open_sensor
from srt3d_ros.errors import InvalidInput
import lz4.frame, rosbags.rosbag2, scipy.io
used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 300 * 2**20,) * 2)
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
    "b.npz": (b"PK\3\4", "b.npz is truncated or damaged", ""),
    "c.mat": (b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM", "c.mat is unreadable", ""),
    "d.mcap": (b"\x89MCAP0\r\n", "bag d.mcap is unreadable", ""),
    "e.db3": (b"SQLite format 3\0", "bag e.db3 is unreadable", ""),
    "g.npy": (b"", "g.npy counts is unreadable", ""),
    "i.ptu": (b"PQTTTR\0\0001.0.00\0\0", "i.ptu is unreadable", "ptufile")}
SENSORS = {
    "pixels.json": ('{"schema_version":1,"rows":65535,"cols":65535,"num_bins":50,"bin_width_s":1e-9,"irf":[1]}',
                    "pixels.json rows × cols is 65535 × 65535: expected at most"),
    "array.json": ('{"schema_version":1,"rows":2,"cols":2,"num_bins":50,"bin_width_s":1e-9,"irf":{"dtype":"float32",'
                   '"shape":[4294967295,4294967295],"base64":""}}',
                   "array.json irf.base64 is 0 bytes: expected 18446744065119617025 numbers")}


def test_a_process_that_may_take_300_mb_refuses_each_in_one_line(tmp_path):
    said = {}
    for name, (begin, line, library) in GIGABYTES.items():
        if not library or find_spec(library):
            (tmp_path / name).write_bytes(begin)
            os.truncate(tmp_path / name, 2**30)
            said |= {name: line} if line else {}
    for name, (text, line) in SENSORS.items():
        (tmp_path / name).write_text(text)
        said[name] = line
    done = subprocess.run([sys.executable, "-c", LIMITED, *(tmp_path / name for name in said)], capture_output=True,
                          text=True)
    assert done.returncode == 0, done.stderr
    for line, expected in zip(done.stdout.splitlines(), said.values(), strict=True):
        assert line.startswith(expected) and "Unable to allocate" not in line and "MemoryError" not in line
