"""Managed nodes: each transition, asked for by another process as `ros2 lifecycle` asks for it."""

import signal

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.messages import sensor_message, sketch_message


def state(graph, name: str) -> str:
    return graph.call(GetState, f"{name}/get_state", GetState.Request()).current_state.label


def test_without_autostart_a_node_waits_for_its_manager_and_works_while_it_is_active(graph, sensor, events):
    node = graph.start("reconstructor", autostart=False).says("unconfigured, as autostart is false")
    sketch = sketch_photons(events, sensor, choose_frequencies("auto", sensor, 10))
    graph.latched("sketch/sensor").publish(sensor_message.encode(sensor))
    sketches, clouds = graph.publisher(PointCloud2, "sketch"), graph.collect(PointCloud2, "points")
    points = f"{graph.namespace}/points"
    assert state(graph, "reconstructor") == "unconfigured"
    assert not graph.node.get_publishers_info_by_topic(points)
    assert graph.set("reconstructor", background="flat") == "" == graph.set("reconstructor", background="auto")
    assert graph.change("reconstructor", "configure") and state(graph, "reconstructor") == "inactive"
    assert graph.reports("reconstructor", "state", "inactive")["message"] == "inactive"
    assert sketches.get_subscription_count() == 0
    for round_ in (1, 2):
        assert graph.change("reconstructor", "activate")
        graph.matched(sketches).publish(sketch_message.encode_cdr(sketch, "spad"))
        graph.wait(lambda: len(clouds) == round_, "a cloud")
        assert graph.change("reconstructor", "deactivate") and state(graph, "reconstructor") == "inactive"
        graph.wait(lambda: sketches.get_subscription_count() == 0, "nobody on sketch")
        if round_ == 1:
            assert graph.change("reconstructor", "cleanup") and state(graph, "reconstructor") == "unconfigured"
            graph.wait(lambda: not graph.node.get_publishers_info_by_topic(points), "no points")
            assert graph.change("reconstructor", "configure")
    assert bytes(clouds[0].data) == bytes(clouds[1].data)
    report = graph.reports("reconstructor", "frames_out", 2)
    assert (report["messages_in"], report["dropped"], report["errors"]) == ("2", "0", "0")
    assert node.end(signal.SIGINT) == 0 and "Traceback" not in node.text
    said = [line.split("]: ")[1] for line in node.lines if "]: sketches: " not in line and "computing" not in line]
    work = ["configured", "ready", "deactivated"]
    assert said[1:] == [*work, "cleaned up", *work, "shutting down"]


def test_parameters_may_be_set_before_a_node_is_active_and_nothing_is_published_before_it_is(graph, sensor, tmp_path):
    (tmp_path / "spad.json").write_text(sensor_message.encode(sensor).data)
    described = graph.collect_latched(String, "sketch/sensor")
    graph.start("sketcher", autostart=False, sensor_file=tmp_path / "spad.json").says("unconfigured")
    assert graph.set("sketcher", sketch_size=5) == "" and graph.set("sketcher", gate="x") != ""
    assert graph.change("sketcher", "configure") and graph.set("sketcher", sketch_size=1) == ""
    assert not graph.change("sketcher", "deactivate") and described == [] and graph.change("sketcher", "activate")
    assert graph.reports("sketcher", "frequencies", 1)["errors"] == "0"


def test_transitions_that_fail_say_why_and_impossible_ones_are_refused(graph, tmp_path):
    folder = tmp_path / "later"
    node = graph.start("recorder", autostart=False, path=folder / "out.rrd").says("unconfigured")
    assert not graph.change("recorder", "configure") and state(graph, "recorder") == "unconfigured"
    node.says("path is ")
    graph.wait(lambda: graph.report("recorder").get("last_error", "").startswith("path is "), "the error's report")
    folder.mkdir()
    assert graph.change("recorder", "configure") and graph.change("recorder", "activate")
    for asked, name in ((Transition(id=Transition.TRANSITION_CONFIGURE), "configure"),  # as Nav2's lifecycle manager
                        (Transition(id=99), "99"), (Transition(label="cleanup"), "cleanup")):
        request = ChangeState.Request(transition=asked)
        assert not graph.call(ChangeState, "recorder/change_state", request).success
        node.says(f"no transition {name} while active")
    assert state(graph, "recorder") == "active" and node.running
    assert graph.change("recorder", "shutdown") and state(graph, "recorder") == "finalized"
    assert node.end(signal.SIGTERM) == 0
    assert node.text.count("]: finalized") == 1
    assert "shutting down" not in node.text and "Traceback" not in node.text
