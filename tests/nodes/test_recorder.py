"""The recorder: what it adds up from the diagnostics of the other nodes, and recordings that services begin and end."""

import signal

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_srvs.srv import Trigger

from srt3d_ros.nodes.diagnostics import PIPELINE_ID
from srt3d_ros.nodes.neighbours import Drops
from tests.nodes.test_pipeline import rows_of


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


def test_recordings_begin_and_end_when_the_services_say_and_each_is_a_file_of_its_own(graph, photon_file, tmp_path):
    path = tmp_path / "out.rrd"
    recorder = graph.start("recorder", path=path, record=False).ready()
    for name in ("reconstructor", "sketcher"):
        graph.start(name).ready()
    graph.start("player", input=photon_file, rate_hz=20.0)
    graph.wait(lambda: int(graph.report("reconstructor").get("frames_out", 0)) > 0, "clouds")
    assert not path.exists()

    def call(service: str) -> Trigger.Response:
        return graph.call(Trigger, f"recorder/{service}", Trigger.Request())

    for expected in (path, tmp_path / "out_2.rrd"):
        before = int(graph.report("recorder").get("clouds", 0))
        answer = call("start_recording")
        assert answer.success and answer.message == f"recording to {expected}"
        assert not call("start_recording").success
        graph.wait(lambda before=before: int(graph.report("recorder").get("clouds", 0)) > before + 5, "recorded clouds")
        answer = call("stop_recording")
        assert answer.success and answer.message == f"recorded {expected}"
    recorded = sum(rows_of(part, "/points", "Points3D:positions") for part in sorted(tmp_path.glob("*.rrd")))
    assert recorder.end(signal.SIGINT) == 0 and "Traceback" not in recorder.text
    assert recorded == int(graph.report("recorder")["clouds"]) > 10
