"""What a player makes of the reports of the nodes behind it."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from srt3d_ros.nodes.reports import Chain, Reports, in_a_line

IDLE = {"ready": "True", "state": "active", "messages_in": "5", "frames_out": "5", "dropped": "0", "message_lost": "0"}


def report(reports: Reports, name: str, hardware_id: str = "srt3d_ros", **values: object) -> None:
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    status = DiagnosticStatus(name=name, hardware_id=hardware_id, message="fine", level=b"\0", values=pairs)
    reports.add(DiagnosticArray(status=[status]))


def test_a_chain_is_ready_when_every_node_is_and_is_read_by_the_next():
    chain = Chain(["a/sketcher", "a/recorder"], reports := Reports())
    report(reports, "a/recorder", "another", **IDLE)
    assert chain.missing("").count("(no report on /diagnostics)") == 2
    report(reports, "a/sketcher", **IDLE | {"ready": False, "waiting_for": "a sensor"}, read_by="")
    report(reports, "a/recorder", **IDLE, read_by="")
    assert chain.missing("a/sketcher") == ("a/sketcher (a sensor), a/recorder (not connected to the node before it)")
    report(reports, "a/sketcher", **IDLE, read_by="rviz, a/recorder")
    assert chain.missing("a/sketcher") == ""


def test_frames_are_accounted_for_from_node_to_node():
    chain = Chain(["sketcher", "reconstructor", "recorder"], reports := Reports())
    for name in ("sketcher", "reconstructor"):
        report(reports, name, **IDLE)
    report(reports, "recorder", **IDLE | {"clouds": 5})
    chain.begin()
    assert chain.outcome(10)[0] == 10
    report(reports, "sketcher", **IDLE | {"messages_in": 14, "message_lost": 1, "packets": 9, "frames_out": 14})
    report(reports, "reconstructor", **IDLE | {"messages_in": 14, "dropped": 2, "dropped.queue": 2, "frames_out": 11},
           reconstruct_ms=9, rate_out_hz=8.61, points_per_s=171093, latency_p50_ms=35.4)
    report(reports, "recorder", **IDLE | {"clouds": 10, "messages_in": 60, "message_lost": 4, "dropped": 9})
    under_way, lost, came = chain.outcome(10)
    assert came == {"sketcher": 9, "reconstructor": 9, "recorder": 5} and under_way == 3
    assert lost == {"on the way to sketcher": 1, "queue in reconstructor": 2, "unfinished in reconstructor": 1,
                    "on the way to recorder": 1}
    assert in_a_line(list(reports.values())) == "8.6 clouds/s, 171,093 points/s, 35 ms old; dropped so far: 16"
