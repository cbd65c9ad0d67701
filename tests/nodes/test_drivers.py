"""Ctrl-C ends the drivers in examples/ between two callbacks, as it ends the nodes."""

import signal
import sys

import pytest
from sensor_msgs.msg import Image

from tools.processes import Process

# rclpy passes a signal on to the handler before its own, which raises KeyboardInterrupt by default: within rclpy, too.
PROGRAM = """
import pathlib, runpy, signal, sys
signal.signal(signal.SIGINT, lambda *_: print("interrupted"))
sys.argv = sys.argv[1:]
sys.path.insert(0, str(pathlib.Path(sys.argv[0]).parent))
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.mark.parametrize(("name", "topic"), [("histogram", "histograms"), ("spad", "gates"), ("tmf8829", "")])
def test_ctrl_c_ends_a_driver_and_interrupts_nothing(graph, repository, name, topic):
    if not topic:
        pytest.importorskip("zmq")
    received = graph.collect(Image, topic or "histograms", raw=True)
    address = () if topic else ("tcp://127.0.0.1:1",)      # nobody is there
    driver = Process([sys.executable, "-c", PROGRAM, str(repository / f"examples/{name}_driver.py"), *address,
                      "--ros-args", "-r", f"__ns:={graph.namespace}"])
    graph.processes.append(driver)
    graph.wait(lambda: received or (not topic and graph.node.count_publishers("histograms")), "the driver")
    assert driver.end(signal.SIGINT) == 0 and "interrupted" not in driver.text
