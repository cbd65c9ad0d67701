"""What is chosen for a distribution is what its middleware reads and makes."""

import subprocess
import sys
from xml.etree import ElementTree

import pytest

from srt3d_ros.nodes import distribution, transport

NODE = """
import re
import rclpy
from srt3d_ros.nodes import distribution, transport
transport.prepare_process()
rclpy.init()
node = rclpy.create_node("any")
for line in open("/proc/self/maps"):
    if re.search(rf"/dev/shm/{distribution.SEGMENT}[0-9a-f]{{16}}$", line):
        begin, end = (int(address, 16) for address in line.split()[0].split("-"))
        print(end - begin)
rclpy.shutdown()
"""


def test_the_middleware_takes_the_profile_without_a_word_and_names_its_segment_as_expected(repository):
    profile = transport.choose_profile()
    if profile is None:
        pytest.skip("no room in /dev/shm")
    (size,) = (int(node.text) for node in ElementTree.parse(profile).iter() if node.tag.endswith("segment_size"))
    done = subprocess.run([sys.executable, "-c", NODE], cwd=repository, capture_output=True, text=True)
    assert done.stderr == "" and any(size <= int(mapped) < 1.1 * size for mapped in done.stdout.split())


def test_a_profile_for_kilted_has_nothing_of_the_other_version(repository):
    for path in (repository / "config" / "kilted").iterdir():
        text = path.read_text(encoding="utf-8")
        assert distribution.kilted(text) == text and "<heartbeat_period>" in text and "FASTRTPS_" not in text
