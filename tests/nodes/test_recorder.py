"""What the recorder adds up from the diagnostics of the other nodes."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from srt3d_ros.nodes.diagnostics import PIPELINE_ID
from srt3d_ros.nodes.recorder import Drops


def report(name: str, dropped: int, lost: int = 0, hardware_id: str = PIPELINE_ID) -> DiagnosticArray:
    values = [KeyValue(key="dropped", value=str(dropped)), KeyValue(key="message_lost", value=str(lost))]
    return DiagnosticArray(status=[DiagnosticStatus(name=name, hardware_id=hardware_id, values=values)])


def test_drops_of_all_nodes_add_up_and_a_restart_does_not_set_them_back():
    drops, totals = Drops(), []
    for message in (report("left/sketcher", 2), report("left/reconstructor", 3, lost=1), report("left/sketcher", 5),
                    report("left/sketcher", 5), report("left/sketcher", 1)):       # the last after a restart
        drops.add(message, "/left")
        totals.append(drops.total)
    assert totals == [2, 6, 9, 9, 10]


def test_other_pipelines_and_other_devices_do_not_count():
    drops = Drops()
    for message in (report("right/sketcher", 2), report("left_too/sketcher", 2),
                    report("left/motor", 4, hardware_id="motor")):
        drops.add(message, "/left")
    assert drops.total == 0
    drops.add(report("sketcher", 2), "/")
    assert drops.total == 2
