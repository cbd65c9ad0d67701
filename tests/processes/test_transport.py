"""Domains of programs on one machine, and what a process is prepared with before rclpy.init, as Fast DDS has it."""

import ast
import contextlib
import fcntl
import mmap
import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest

from srt3d_ros.processes import transport
from srt3d_ros.processes.private_network import FIRST_PORT, PORTS, bind, claim_domain

SEGMENT = transport.FAST_DDS.segment


@pytest.mark.parametrize(("libraries", "found"), [
    (["libfastrtps.so", "libfastdds.so"], transport.FAST_DDS_2), (["libfastdds.so", "libfastrtps.so"],
                                                                  transport.FAST_DDS_3),
    (["libother.so", "libfastdds.so"], transport.FAST_DDS_3)])
def test_the_version_of_fast_dds_is_that_of_the_first_folder_of_libraries_that_has_one(tmp_path, monkeypatch, libraries,
                                                                                        found):
    folders = [tmp_path / library.removesuffix(".so") for library in libraries]
    for folder, library in zip(folders, libraries):
        folder.mkdir()
        (folder / library).touch()
    monkeypatch.setenv("LD_LIBRARY_PATH", ":".join(map(str, folders)))
    assert transport.installed_fast_dds() is found


@pytest.mark.parametrize("purpose", ["shm", "network"])
def test_the_profiles_of_both_versions_differ_in_names_alone(repository, purpose):
    old, new = ((repository / version.profiles.format(purpose)).read_text()
                for version in (transport.FAST_DDS_2, transport.FAST_DDS_3))
    names = {"Fast DDS 2 (ROS 2 Jazzy)": "Fast DDS 3 (ROS 2 Kilted)", "FASTRTPS_DEFAULT": "FASTDDS_DEFAULT",
             "fastdds_shm": "fastdds3_shm", "heartbeatPeriod": "heartbeat_period"}
    for name, other in names.items():
        old = old.replace(name, other)
    assert old == new


@pytest.mark.parametrize("free_mb, segment_mb", [(1000, 64), (256, 64), (64, 16), (16, 4), (15, None)])
def test_the_segment_fits_four_times_into_free_shared_memory(monkeypatch, free_mb, segment_mb):
    room = os.statvfs_result((4096, 4096, 0, 0, free_mb * 256, 0, 0, 0, 0, 255))
    monkeypatch.setattr(os, "statvfs", lambda path: room)
    profile = transport.shared_memory_profile()
    if segment_mb is None:
        assert profile is None
    else:
        sizes = [node.text for node in ElementTree.parse(profile).iter() if node.tag.endswith("segment_size")]
        assert sizes == [str(segment_mb * 2**20)]


def test_without_shared_memory_the_default_stays(tmp_path):
    assert transport.shared_memory_profile(tmp_path / "absent") is None


PREPARED = """
import os, sys
from srt3d_ros.processes import transport
transport.FAST_DDS = getattr(transport, sys.argv[1])
transport.prepare_process()
print({name: os.environ[name] for name in os.environ if name.endswith("DEFAULT_PROFILES_FILE")})
"""


@pytest.mark.parametrize("version", ["FAST_DDS_2", "FAST_DDS_3"])
def test_a_process_is_prepared_with_the_profile_unless_the_user_chose_one(repository, version):
    def prepared(**own: str) -> dict[str, str]:
        environment = {name: value for name, value in os.environ.items() if "PROFILES_FILE" not in name} | own
        return ast.literal_eval(subprocess.check_output([sys.executable, "-c", PREPARED, version], cwd=repository,
                                                        env=environment, text=True))

    variables = getattr(transport, version).variables
    if transport.shared_memory_profile():
        ((variable, profile),) = prepared().items()
        assert variable == variables[0] and profile.endswith("_shm.xml")
    for variable in variables:
        assert prepared(**{variable: "/my/own.xml"}) == {variable: "/my/own.xml"}


def test_segments_of_killed_processes_are_given_back_and_those_of_others_kept(tmp_path):
    def segment(name: str, age_s: float):
        for path in (tmp_path / f"{SEGMENT}{name}", tmp_path / f"{SEGMENT}{name}_el"):
            path.write_bytes(b"x")
            os.utime(path, (0, path.stat().st_mtime - age_s))
        return path

    segment("00000000000000aa", age_s=100)
    gone = tmp_path / f"{SEGMENT}00000000000000dd_el"     # listed, and removed by another process just now
    gone.symlink_to(tmp_path / "absent")
    alive, new = segment("00000000000000bb", age_s=100), segment("00000000000000cc", age_s=0)
    with alive.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        transport.remove_leaked_segments(tmp_path)
    gone.unlink()
    kept = {alive.name, new.name}
    assert {path.name for path in tmp_path.iterdir()} == kept | {name.removesuffix("_el") for name in kept}


RESERVES = """
import sys
from pathlib import Path
from srt3d_ros.processes import transport
transport.reserve_stale_ports(Path(sys.argv[1]))
print("reserved", flush=True)
input()
"""


def test_ports_of_killed_processes_are_avoided_while_others_send_to_them_and_then_removed(repository, tmp_path):
    """Two have a writer and no reader, one only in memory; two have a reader, one nobody; one is of another domain."""
    def port(number: int, mapped: bool) -> None:
        path = tmp_path / f"{SEGMENT}port{number}"
        path.write_bytes(b"x")
        os.utime(path, (0, 0))
        if mapped:
            with path.open("r+b") as file:
                opened.enter_context(mmap.mmap(file.fileno(), 1))

    def in_use(number: int) -> bool:
        for one in (bound := bind(number)):
            one.close()
        return not bound

    with contextlib.ExitStack() as opened:
        first = FIRST_PORT + PORTS * (domain := claim_domain())
        for number, mapped in {211: True, 213: True, 215: True, 217: False, 219: False, 461: False}.items():
            port(first + number, mapped)
        lock = opened.enter_context((tmp_path / f"{SEGMENT}port{first + 219}_el").open("wb"))
        fcntl.flock(lock, fcntl.LOCK_EX)        # in a container of its own, which shares the memory, not the network
        os.utime(lock.name, (0, 0))
        (tmp_path / f"{SEGMENT}port{first + 213}").unlink()
        opened.enter_context(bind(first + 215)[0])      # a reader
        process = opened.enter_context(subprocess.Popen(
            [sys.executable, "-c", RESERVES, tmp_path], cwd=repository, env=os.environ | {"ROS_DOMAIN_ID": str(domain)},
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True))
        assert process.stdout.readline() == "reserved\n"
        assert [number for number in range(200, 230) if in_use(first + number)] == [210, 211, 212, 213, 215]
        left = {int(path.name.removeprefix(f"{SEGMENT}port")) - first for path in tmp_path.glob("*[0-9]")}
        process.communicate("\n")
    assert left == {211, 215, 219, 461} and len(list(tmp_path.glob("*_el"))) == 1


LARGE_BUFFERS = """
import resource, threading
from srt3d_ros.processes import transport
def make_and_drop():
    for _ in range(4):
        bytes(bytearray(100_000_000))
        faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)
transport.prepare_process()
faults = []
make_and_drop()
thread = threading.Thread(target=make_and_drop)
thread.start()
thread.join()
print(max(after - before for before, after in zip(faults[1:], faults[2:])))
"""


def test_freed_buffers_of_large_messages_are_used_again_in_every_thread(repository):
    done = subprocess.run([sys.executable, "-c", LARGE_BUFFERS], cwd=repository, capture_output=True, text=True)
    assert int(done.stdout) < 1_000, done.stderr        # page faults; each such message would take 48,000


NODE = """
import re
import rclpy
from srt3d_ros.processes import transport
transport.prepare_process()
rclpy.init()
node = rclpy.create_node("any")
for line in open("/proc/self/maps"):
    if re.search(rf"/dev/shm/{transport.FAST_DDS.segment}[0-9a-f]{{16}}$", line):
        begin, end = (int(address, 16) for address in line.split()[0].split("-"))
        print(end - begin)
rclpy.shutdown()
"""


@pytest.mark.parametrize("purpose", ["shm", "network"])
def test_the_middleware_takes_a_profile_without_a_word_and_names_its_segment_as_expected(repository, purpose):
    profile = transport.shared_memory_profile()
    if profile is None:
        pytest.skip("no room in /dev/shm")
    environment = dict(os.environ)
    if purpose == "network":
        profile = repository / transport.FAST_DDS.profiles.format(purpose)
        environment[transport.FAST_DDS.variables[0]] = str(profile)
    (size,) = (int(node.text) for node in ElementTree.parse(profile).iter() if node.tag.endswith("segment_size"))
    done = subprocess.run([sys.executable, "-c", NODE], cwd=repository, env=environment, capture_output=True, text=True)
    assert done.stderr == "" and any(size <= int(mapped) < 1.1 * size for mapped in done.stdout.split())


CLAIMS = """
from srt3d_ros.processes import private_network
from srt3d_ros.processes.private_network import claim_domain
claimed = [claim_domain() for _ in range(20)]
assert len(set(claimed)) == 20 and all(1 <= domain <= private_network.MOST for domain in claimed)
private_network.MOST, private_network.FIRST_PORT = 2, 30_000        # others on this machine may use the real ones
with private_network.bind(30_000 + private_network.PORTS + private_network.USED_PORT)[0]:
    assert claim_domain() == 2
    claim_domain()
"""


def test_no_two_programs_have_the_same_domain_and_one_in_use_is_left_alone(repository):
    done = subprocess.run([sys.executable, "-c", CLAIMS], cwd=repository, capture_output=True, text=True)
    assert done.stderr.splitlines()[-1] == "OSError: every ROS domain from 1 to 2 is in use on this machine"
