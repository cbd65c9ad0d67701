"""What is set before rclpy is imported."""

import fcntl
import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest

from srt3d_ros.nodes import transport


@pytest.mark.parametrize("free_mb, segment_mb", [
    (4000, 64), (256, 64), (255, 32), (128, 32), (64, 16), (63, 4), (15, None)])
def test_the_segment_fits_four_times_into_free_shared_memory(monkeypatch, free_mb, segment_mb):
    room = os.statvfs_result((4096, 4096, 0, 0, free_mb * 256, 0, 0, 0, 0, 255))
    monkeypatch.setattr(os, "statvfs", lambda path: room)
    profile = transport.choose_profile()
    if segment_mb is None:
        assert profile is None
    else:
        sizes = [node.text for node in ElementTree.parse(profile).iter() if node.tag.endswith("segment_size")]
        assert sizes == [str(segment_mb * 2**20)]


def test_without_shared_memory_the_default_stays(tmp_path):
    assert transport.choose_profile(tmp_path / "absent") is None


def test_the_profiles_differ_in_size_alone(repository):
    texts = {size: (repository / "config" / f"fastdds_{size}mb.xml").read_text() for size in transport.SEGMENTS_MB}
    same = {text.replace(f"{size} MB", "").replace(str(size * 2**20), "") for size, text in texts.items()}
    assert len(same) == 1


@pytest.mark.parametrize("given", [None, "/my/own.xml"])
def test_importing_the_nodes_sets_the_profile_unless_the_user_did(repository, given):
    environment = {key: value for key, value in os.environ.items() if key != transport.PROFILE_VARIABLE}
    environment |= {transport.PROFILE_VARIABLE: given} if given else {}
    code = ("import os, sys, srt3d_ros.nodes;"
            f"print(os.environ.get('{transport.PROFILE_VARIABLE}'), 'rclpy' in sys.modules, sep='\\n')")
    out = subprocess.run([sys.executable, "-c", code], env=environment, cwd=repository, capture_output=True, text=True)
    expected = given or transport.choose_profile()
    assert out.stdout.splitlines() == [str(expected), "False"]


def test_segments_of_killed_processes_are_given_back_and_those_of_others_kept(tmp_path):
    def segment(name: str, age_s: float):
        for path in (tmp_path / f"fastrtps_{name}", tmp_path / f"fastrtps_{name}_el"):
            path.write_bytes(b"x")
            os.utime(path, (0, path.stat().st_mtime - age_s))
        return path

    segment("00000000000000aa", age_s=100)
    alive, new = segment("00000000000000bb", age_s=100), segment("00000000000000cc", age_s=0)
    with alive.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        transport.remove_leaked_segments(tmp_path)
    kept = {alive.name, new.name}
    assert {path.name for path in tmp_path.iterdir()} == kept | {name.removesuffix("_el") for name in kept}
