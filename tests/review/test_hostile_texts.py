"""Texts of an untrusted recording: the report shows them and executes none of them."""

import re

import pytest
import rerun as rr

from srt3d_ros.review import gallery
from srt3d_ros.review.recorded import Recorded
from srt3d_ros.review.report import write_report
from srt3d_ros.review.summary import summarise
from tests.review.conftest import Page

EVIL = "\"'><script>alert(1)</script><img src=x onerror=alert(2)>{{ 7 * 7 }}]]>--><svg onload=alert(3)>"


@pytest.fixture
def report(ball, write_recording, tmp_path, monkeypatch):
    """The report of a recording in which every text that it can carry is hostile, its own name included."""
    monkeypatch.setattr(gallery, "_LARGE_PX", (300, 175))
    path, out = tmp_path / f"{EVIL.replace('/', '∕')}.rrd", tmp_path / "report.html"
    write_recording(path, *ball, frames=6, more=log_hostile_texts)
    recorded = Recorded.read(path)
    write_report(recorded, summarise(recorded), out)
    return out.read_text()


def log_hostile_texts(stream):
    stream.send_property("run", rr.AnyValues(machine=EVIL, **{EVIL: EVIL}))
    stream.send_property("versions", rr.AnyValues(srt3d_ros=EVIL, rmw=EVIL))
    for name in (f"latency_{EVIL}_ms", EVIL):
        stream.log(["metrics", name], rr.Scalars(4.0))
    stream.log("/log", rr.TextLog(EVIL, level=EVIL))


def test_no_text_of_a_recording_becomes_a_part_of_the_page(report):
    page = Page(report)
    assert "@import" not in report and not re.search(r"url\((?!#)", report)
    assert page.text.count(EVIL) >= 5
    assert {tag for tag, _ in page.tags}.isdisjoint({"script", "iframe", "object", "embed", "link", "base", "form"})
    for tag, attributes in page.tags:
        assert not any(name.startswith("on") for name in attributes), (tag, attributes)
        for name in ("src", "href", "xlink:href"):
            target = attributes.get(name) or "#"
            assert target.startswith(("data:image/", "#")), (tag, target[:80])
