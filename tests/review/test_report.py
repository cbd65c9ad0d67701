"""The report: complete, safe, self-contained, and shown by a browser without an error."""

import base64
import io
import re
import shutil
import subprocess

import numpy as np
import pytest
import rerun as rr
from PIL import Image

from srt3d_ros.review import gallery
from srt3d_ros.review.recorded import Recorded
from srt3d_ros.review.report import write_report
from srt3d_ros.review.summary import summarise
from tests.review.conftest import Page, write_ball

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.fixture(scope="module", autouse=True)
def small_pictures():
    """So that the tests are quick; the command line's test makes large ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gallery, "_LARGE_PX", (300, 175))
        yield


@pytest.fixture(scope="module")
def report(recorded, tmp_path_factory):
    """The report of the ball's recording."""
    path = tmp_path_factory.mktemp("report") / "ball.html"
    write_report(recorded, summarise(recorded), path)
    return path


def test_everything_that_belongs_in_it_is_in_it(report):
    page = Page(report.read_text())
    for expected in ("ball.rrd", "2026-11-21 18:18:42.000Z, 2.9 s", "Frame 17: typical", "end to end", "latency, ms",
                     "photons", "at 0.9 s, after frame 9", "about 2 frames", "0123456789abcdef", "bins of 20 ps",
                     "median 43.5 ms"):
        assert expected in page.text, expected
    assert [tag for tag, _ in page.tags].count("svg") == 3 and "#010203" not in report.read_text()
    sources = [attributes["src"] for tag, attributes in page.tags if tag == "img"]
    assert len(sources) == 1 + 12 + 2        # typical, strip, depth and background
    for source in sources[:13]:
        assert source.startswith("data:image/jpeg;") and (shown(source).max(axis=2) > 60).mean() > 0.1
    assert shown(sources[13]).shape == (40, 48, 3)


def shown(source: str) -> np.ndarray:
    """The picture of a data: URI, int [rows, cols, 3]."""
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(source.split(";base64,")[1]))).convert("RGB")).astype(int)


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
@pytest.mark.parametrize("width, height, dark", [(1280, 1600, False), (390, 1600, True)])
def test_chromium_shows_it_wide_and_narrow_light_and_dark(report, tmp_path, width, height, dark):
    scheme = ["--blink-settings=preferredColorScheme=0"] if dark else []
    done = subprocess.run(
        [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--enable-logging=stderr",
         f"--user-data-dir={tmp_path / 'profile'}", f"--window-size={width},{height}",
         f"--screenshot={tmp_path / 'a.png'}", *scheme, report.as_uri()], capture_output=True, text=True, timeout=120)
    assert not [line for line in done.stderr.splitlines() if "CONSOLE" in line and "chrome://" not in line]
    picture = np.asarray(Image.open(tmp_path / "a.png").convert("RGB")).astype(int)
    corner = picture[2, 2]
    assert (corner.max() < 40) if dark else (corner.min() > 230)
    assert ((np.abs(picture - corner).sum(axis=2) > 60).mean(axis=1) > 0).mean() > 0.5     # something all the way down
    assert (np.abs(picture[:, -4:] - corner).sum(axis=2) < 60).all()                        # nothing runs off the side


def test_a_recording_with_clouds_alone_has_a_report(tmp_path, ball):
    write_ball(tmp_path / "a.rrd", *ball, frames=1)
    recorded = Recorded(tmp_path / "a.rrd")
    write_report(recorded, summarise(recorded), tmp_path / "a.html")
    text = (tmp_path / "a.html").read_text()
    assert "Frame 0: typical" in text and "Over time" not in text.split("<h2>Figures")[0]


EVIL = "\"'><script>alert(1)</script><img src=x onerror=alert(2)>{{ 7 * 7 }}]]>--><svg onload=alert(3)>"


@pytest.fixture
def hostile_report(ball, tmp_path):
    """The report of a recording in which every text that it can carry is hostile, its own name included."""
    path, out = tmp_path / f"{EVIL.replace('/', '∕')}.rrd", tmp_path / "report.html"
    write_ball(path, *ball, frames=6, more=log_hostile_texts)
    recorded = Recorded(path)
    write_report(recorded, summarise(recorded), out)
    return out.read_text()


def log_hostile_texts(stream):
    stream.send_property("run", rr.AnyValues(machine=EVIL, **{EVIL: EVIL}))
    stream.send_property("versions", rr.AnyValues(srt3d_ros=EVIL, rmw=EVIL))
    for name in (f"latency_{EVIL}_ms", EVIL):
        stream.log(["metrics", name], rr.Scalars(4.0))


def test_no_text_of_a_recording_becomes_a_part_of_the_page(hostile_report):
    page = Page(hostile_report)
    assert "@import" not in hostile_report and not re.search(r"url\((?!#)", hostile_report)
    assert page.text.count(EVIL) >= 5
    assert {tag for tag, _ in page.tags}.isdisjoint({"script", "iframe", "object", "embed", "link", "base", "form"})
    for tag, attributes in page.tags:
        assert not any(name.startswith("on") for name in attributes), (tag, attributes)
        for name in ("src", "href", "xlink:href"):
            target = attributes.get(name) or "#"
            assert target.startswith(("data:image/", "#")), (tag, target[:80])
