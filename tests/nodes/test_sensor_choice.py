"""Which sensor the sketcher reads photons with: a file's or a driver's, whoever starts first."""

import dataclasses

from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.messages import photon_frames, sensor_message


def test_a_driver_that_contradicts_the_file_is_an_error_as_long_as_it_does(graph, sensor, events, photons_at, tmp_path):
    """The file's sensor is published; the driver is there first, is right for a while, wrong again, and goes."""
    published = graph.collect_latched(String, "sensor")
    sketches, described = graph.collect(PointCloud2, "sketch"), graph.latched("sensor")
    topic, other, path = f"{graph.namespace}/sensor", sensor.replace(rows=10, cols=8), tmp_path / "spad.json"
    described.publish(sensor_message.encode(other))
    path.write_text(sensor_message.encode(sensor).data)
    process = graph.start("sketcher", sensor_file=path).ready()
    graph.wait(lambda: any(sensor_message.from_json(one.data).same_as(sensor) and "x_writer" in one.data
                           for one in published), "the sensor of the file")
    problem = (f"rows on {topic} is 10: expected 16 as in sensor_file spad.json; photons are dropped until both "
               "agree")
    process.says(problem)
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    pixels = dataclasses.replace(events, pixel=events.pixel % other.pixels)
    photons.publish(photon_frames.PHOTONS.encode_cdr(pixels, other, "spad"))
    graph.reports("sketcher", "dropped.no_sensor", 1)
    assert all((report["level"], report["message"]) == (DiagnosticStatus.ERROR, problem)
               for report in graph.next_reports("sketcher", 2))         # as long as it lasts
    report = graph.report("sketcher")
    assert (report["rows"], report["frames_out"], len(sketches)) == ("16", "0", 0)

    described.publish(sensor_message.encode(sensor))        # the driver is right now
    process.says(f"sensor_file spad.json is used again: {topic} agrees again")
    photons.publish(photons_at(0))
    graph.wait(lambda: sketches, "a sketch")
    assert (sketches[0].height, sketches[0].width) == (16, 12) and process.text.count("[ERROR]") == 1

    described.publish(sensor_message.encode(sensor.replace(toa_offset_bins=3.5)))
    graph.wait(lambda: "is 3.5: expected 0.0 as in sensor_file spad.json" in graph.report("sketcher")["message"],
               "another contradiction")
    graph.node.destroy_publisher(described)
    graph.wait(lambda: graph.node.count_publishers("sensor") == 1, "the driver to be gone")
    graph.known_to("sketcher")
    photons.publish(photons_at(0))
    process.says(f"is used again: {topic} has no other publisher any more")
    graph.wait(lambda: graph.report("sketcher")["level"] != DiagnosticStatus.ERROR, "the end of the error")


def test_a_sensor_of_more_than_max_pixels_is_refused_by_sketcher_and_reconstructor(graph, sensor):
    graph.latched("sensor").publish(sensor_message.encode(sensor.replace(rows=1024, cols=1024)))
    graph.latched("sketch/sensor").publish(sensor_message.encode(sensor))
    for name, most in (("sketcher", 2**19), ("reconstructor", 100)):
        graph.start(name, **({"max_pixels": most} if most == 100 else {})).says(
            f"exceeds max_pixels of {name}, {most}: set a larger one")
