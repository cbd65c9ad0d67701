"""A node's status goes over /diagnostics as it is; other reports are not taken for one."""

import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from srt3d_ros.nodes.common.status import LEVELS, NodeStatus

STATUS = NodeStatus("front/sketcher", "ERROR", "gate is 500-600: expected 0 to 399", 12.5, "active", False, "a frame",
                    ("front/reconstructor", "rviz"), (), {"messages_in": 5, "dropped.queue": 1},
                    {"rate_in_hz": 9.5, "device": "cpu: no GPU"}, "front/spad")


def test_a_status_is_the_same_behind_its_message():
    assert NodeStatus.from_message(STATUS.to_message()) == STATUS
    assert {name: NodeStatus("a", name).failed for name in LEVELS} == {
        "OK": False, "WARN": False, "ERROR": True, "STALE": True}


@pytest.mark.parametrize("level, values", [
    (b"\0", {"state": "active", "ready": "True"}), (b"\0", {"since_s": "long", "ready": "True"}),
    (b"\7", {"since_s": "1.0", "ready": "True"})])
def test_what_others_report_is_no_status(level, values):
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    assert NodeStatus.from_message(DiagnosticStatus(name="lidar", level=level, values=pairs)) is None
