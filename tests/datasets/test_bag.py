"""Bags as they are read: what is in them, and bags that are broken."""

import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType

from srt3d_ros import read
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonHistograms
from srt3d_ros.datasets.bags.bag import Bag
from srt3d_ros.datasets.bags.frames import find_photons
from srt3d_ros.datasets.options import ASSUMED_FOV, ASSUMED_WIDTH
from srt3d_ros.errors import InvalidInput
from srt3d_ros.files import json_text
from srt3d_ros.messages import cdr, photon_frames, sensor_message
from srt3d_ros.messages import sketch_message as sketches
from srt3d_ros.messages.photon_frames import GATES as gates
from srt3d_ros.messages.photon_frames import HISTOGRAMS as histograms
from srt3d_ros.messages.sensor_message import digest
from tests.bags import CLOUD, IMAGE, START_NS, STORAGES, TEXT, write_bag, write_mcap
from tests.photon_forms import as_gates, as_histograms

SENSOR = SensorModel(rows=2, cols=3, num_bins=50, bin_width_s=1e-10, irf=[1, 2, 1], gates=GateWords(), frame_id="spad")
OTHER = SENSOR.replace(num_bins=40)


def described(sensor: SensorModel) -> bytes:
    return cdr.write_text(sensor_message.to_json(sensor))


def frame(k: int, sensor: SensorModel = SENSOR) -> PhotonEvents:
    return PhotonEvents(np.array([5, 0, 2], np.uint32), np.array([k, 7, 9], np.uint16), START_NS + k)


def photons_of(k: int) -> bytes:
    return photon_frames.PHOTONS.encode_cdr(frame(k), SENSOR, "spad")


def gates_of(k: int) -> bytes:
    return gates.encode_cdr(as_gates(frame(k), SENSOR), SENSOR, "spad")


def storage_file(bag: Path) -> Path:
    return next(path for path in bag.iterdir() if path.suffix in (".mcap", ".db3"))


RECORDED = [("/sensor", TEXT, described(SENSOR)), *(("/photons", CLOUD, photons_of(k)) for k in range(3))]


@pytest.fixture(params=STORAGES)
def storage(request) -> str:
    return request.param


@pytest.fixture
def bag(tmp_path, storage) -> Path:
    return write_bag(tmp_path / "bag", RECORDED, storage)


def test_a_bag_gives_back_the_bytes_that_it_was_given(bag):
    with Bag(storage_file(bag)) as opened:
        alone = list(opened.messages(opened.topics))
    with Bag(bag) as opened:
        assert {(topic.name, topic.type, topic.messages) for topic in opened.topics} == {
            ("/sensor", TEXT, 1), ("/photons", CLOUD, 3)}
        read = list(opened.messages(opened.topics))
    assert read == [(topic, raw) for topic, _, raw in RECORDED]
    assert alone == read


def test_several_files_are_read_in_the_order_of_their_times(tmp_path):
    bag = write_bag(tmp_path / "bag", RECORDED)
    write_bag(tmp_path / "later", [("/photons", CLOUD, photons_of(7))], first=10)
    name = storage_file(tmp_path / "later").name
    storage_file(tmp_path / "later").rename(bag / name)
    assert [read(bag, number).frame.toa[0] for number in range(4)] == [0, 1, 2, 7]


@pytest.mark.parametrize("storage, mode", [("mcap", "STORAGE"), *((storage, "MESSAGE") for storage in STORAGES)])
def test_packed_bags_are_read_in_place_within_a_limit(tmp_path, storage, mode, monkeypatch):
    bag = write_bag(tmp_path / "bag", RECORDED, storage, compressed=mode)
    assert [read(bag, number).frame.toa[0] for number in range(3)] == [0, 1, 2]
    monkeypatch.setattr("srt3d_ros.datasets.bags.storage.MAX_RECORD_BYTES", 100)
    with pytest.raises(InvalidInput, match="bag is unreadable .*(more than 100|too big)"):
        read(bag)


def test_a_file_that_is_packed_or_was_not_closed_is_refused_with_what_to_do(tmp_path, storage):
    packed = write_bag(tmp_path / "packed", RECORDED, storage, compressed="FILE")
    for path in (packed, next(packed.glob("*.zstd"))):
        with pytest.raises(InvalidInput, match="packed as a whole: unpack it with zstd -d .*zstd$"):
            read(path)
    bag = write_bag(tmp_path / "bag", RECORDED, "sqlite3")
    bag.joinpath(f"{storage_file(bag).name}-wal").write_bytes(bytes(100))
    with pytest.raises(InvalidInput, match="was not closed: .*-wal has its last messages. sqlite3 .* moves them"):
        read(bag)


@pytest.mark.parametrize("chunks", [
    {"use_chunking": False}, *({"chunk_size": 1, "compression": kind} for kind in CompressionType)])
def test_the_whole_messages_of_a_file_that_was_cut_off_are_read(tmp_path, chunks):
    whole = write_mcap(tmp_path / "whole.mcap", RECORDED, **chunks).read_bytes()
    cut, expected, counts = tmp_path / "cut.mcap", [(topic, raw) for topic, _, raw in RECORDED], set()
    # What a disk may show of blocks that were not written. Only chunks have a checksum.
    tails = (b"", bytes(500), b"\xa5" * 500)[:3 if "chunk_size" in chunks else 1]
    for end in range(8, len(whole), 7):
        tail = tails[end % len(tails)]
        cut.write_bytes(whole[:end] + tail)
        with Bag(cut) as bag:
            found = list(bag.messages(bag.topics))
            assert f"cut.mcap was cut off: its {len(found)} whole messages are read" in bag.notes[0]
        assert found == expected[:len(found)] and len(found) >= max(counts, default=0)
        counts.add(len(found))
    assert counts == {0, 1, 2, 3, 4}
    frame = read(cut, 2)
    assert frame.frame.toa[0] == 2 and frame.notes == bag.notes
    with pytest.raises(InvalidInput, match="frame is 3: expected 0 to 2, .*was cut off: its 4 whole messages"):
        read(cut, 3)


def test_open_photons_gives_the_frame_that_is_asked_for(bag):
    for number in range(3):
        opened = read(bag, number)
        assert opened.sensor.same_as(SENSOR) and opened.frame.toa.tolist() == [number, 7, 9]
        assert opened.frame.stamp_ns == START_NS + number
    assert read(bag, range_offset_m=2.0, fov_deg=20).sensor.range_offset_m == 2.0
    content = sensor_message.to_object(SENSOR)
    del content["projection"]
    plain = write_bag(bag / "plain", [("/sensor", TEXT, cdr.write_text(json_text.dump(content))), RECORDED[1]])
    assert (read(bag).notes, read(plain).notes) == ((), (ASSUMED_FOV,))
    with pytest.raises(InvalidInput, match=r"frame is 3: expected 0 to 2"):
        read(bag, 3)


def test_what_looks_wrong_in_a_bag_is_noted(tmp_path):
    sensor = SENSOR.replace(irf=np.r_[np.full(20, 0.01), 1, 2, 1, np.full(20, 0.01)])
    content = sensor_message.to_object(sensor)
    del content["toa_offset_bins"], content["range_offset_m"]
    leaking = PhotonEvents(np.zeros(100, np.uint32), np.r_[np.zeros(60), np.full(40, 9)].astype(np.uint16))
    raw = photon_frames.PHOTONS.encode_cdr(leaking, SENSOR, "spad")
    bag = write_bag(tmp_path / "bag", [("/sensor", TEXT, cdr.write_text(json_text.dump(content))),
                                       ("/photons", CLOUD, raw)])
    floor, leak, half = read(bag).notes
    assert "IRF's floor" in floor and "60% of the photons are in the first bin" in leak and "7.49 mm short" in half
    assert np.count_nonzero(read(bag).sensor.irf) == 3 and len(read(bag, toa_offset_bins=0.5, gate=(1, 49)).notes) == 3


def test_no_ros_is_needed(tmp_path, repository):
    bag = write_bag(tmp_path / "bag", RECORDED)
    script = ("import sys\n"
              "for name in ('rclpy', 'sensor_msgs', 'std_msgs', 'builtin_interfaces'): sys.modules[name] = None\n"
              "from srt3d_ros.datasets import read\n"
              f"print(read({str(bag)!r}, 2).frame.toa.tolist())")
    done = subprocess.run([sys.executable, "-c", script], cwd=repository, capture_output=True, text=True)
    assert done.stdout == "[2, 7, 9]\n", done.stderr


def test_histograms_are_read_as_they_are(tmp_path):
    counts = np.full((2, 3, 50), -1, np.int32)
    raw = histograms.encode_cdr(PhotonHistograms(counts, START_NS), SENSOR, "spad")
    bag = write_bag(tmp_path / "bag", [RECORDED[0], ("/histograms", IMAGE, raw), ("/histograms", IMAGE, raw.replace(
        b"\xff", b"\0"))])
    opened = read(bag)
    assert (opened.frame.counts == counts).all() and opened.frame.stamp_ns == START_NS
    assert read(bag, 1, gate=(10, 39)).frame.photons == 0
    with pytest.raises(InvalidInput, match="histograms is negative or fractional in places"):
        read(bag, gate=(10, 39))


def test_a_bag_of_sketches_gives_sketches_seen_by_another_sensor_if_it_is_given(tmp_path):
    bag = write_bag(tmp_path / "bag", [("/sketch", CLOUD, SKETCH), ("/sketch/sensor", TEXT, described(SENSOR))])
    sketch = read(bag)
    assert sketch.sensor.same_as(SENSOR) and sketch.frequencies == (1,) and sketch.photons[0, 0] == 3
    assert read(bag, fov_deg=20).notes == ("as given, not as in the file: projection",)
    with pytest.raises(InvalidInput, match="^num_bins is 40: expected 50, as in the file"):
        read(bag, num_bins=40)


def test_sketches_are_read_with_the_descriptions_that_they_name(tmp_path):
    """Whatever came before: late descriptions, a sketch of an earlier one, and one whose description is missing."""
    sensors = [SENSOR, OTHER, SENSOR.replace(range_offset_m=1.0)]
    steps = [(1, OTHER), SENSOR, (0, SENSOR), OTHER, (2, SENSOR), (3, OTHER), (4, sensors[2]), (5, SENSOR)]
    bag = write_bag(tmp_path / "bag", [
        ("/sketch", CLOUD, sketch_of(step[1], (1, 2 + step[0]), step[0])) if isinstance(step, tuple) else
        ("/sketch/sensor", TEXT, described(step)) for step in steps] + [("/sketch", CLOUD, SKETCH[:90])])
    wanted = [step for step in steps if isinstance(step, tuple)]
    for number in (0, 1, 2, 3, 5):
        sketch = read(bag, number)
        assert sketch.sensor.num_bins == wanted[number][1].num_bins
        assert (sketch.stamp_ns, sketch.frequencies) == (wanted[number][0], (1, 2 + wanted[number][0]))
    missing = f"Frame 4 needs the description sensor_{digest(sensors[2])}, which is missing"
    for number, said in ((4, missing), (6, "fields.offset is cut off"), (7, "frame is 7: expected 0 to 6")):
        with pytest.raises(InvalidInput, match=said):
            read(bag, number)


@pytest.mark.parametrize("kind", [*STORAGES, "without index"])
def test_photons_are_read_with_the_last_description_before_them(tmp_path, kind):
    """Two descriptions, the first of which comes late, and messages that were recorded at the same time."""
    steps = [(1, 0), (1, 1), (1, SENSOR), (2, 2), (2, OTHER), (2, 3), (3, 4)]
    write_bag(tmp_path / "bag", [
        ("/photons", CLOUD, photons_of(what), time) if isinstance(what, int) else
        ("/sensor", TEXT, described(what), time) for time, what in steps], kind if kind in STORAGES else "mcap")
    if kind == "without index":
        whole = (file := storage_file(tmp_path / "bag")).read_bytes()
        file.write_bytes(whole[:-28] + bytes(16) + whole[-12:])        # where the summary begins
    found = [read(tmp_path / "bag", number) for number in range(5)]
    assert [one.frame.toa[0] for one in found] == list(range(5))
    assert [one.sensor.num_bins for one in found] == [50, 50, 50, 40, 40]


def sketch_of(sensor, frequencies: tuple[int, ...] = (1,), stamp_ns: int = 0) -> bytes:
    seen = PhotonEvents(np.zeros(3, np.uint32), np.zeros(3, np.uint16), stamp_ns)
    return sketches.encode_cdr(sketch_photons(seen, sensor, frequencies), "lidar")


SKETCH = sketch_of(SENSOR)
MESSAGES = {
    "photons": (CLOUD, photons_of(0)), "gates": (IMAGE, gates_of(0)), "sensor": (TEXT, described(SENSOR)),
    "histograms": (IMAGE, histograms.encode_cdr(as_histograms(frame(0), SENSOR), SENSOR, "spad")),
    "sketch": (CLOUD, SKETCH), "map": (TEXT, cdr.write_text('{"name": "map"}')),
    "picture": (IMAGE, cdr.Image(cdr.Header(0, "eye"), 2, 3, "8UC3", False, 9, memoryview(bytes(18))).write()),
    "points": (CLOUD, b"\0\1\0\0")}


def with_topics(path: Path, topics: dict[str, str]) -> Path:
    """A bag with a message on each topic, of a key of MESSAGES."""
    return write_bag(path, [(name, *MESSAGES[kind]) for name, kind in topics.items()])


@pytest.mark.parametrize("topics, given, found", [
    ({"/spad/raw": "photons", "/spad/info": "sensor"}, {}, ("photons", "/spad/raw", "/spad/info")),
    ({"/photons": "photons", "/old": "photons", "/points": "points", "/sensor": "sensor", "/log": "map"}, {},
     ("photons", "/photons", "/sensor")),
    ({"/a/photons": "photons", "/b/photons": "photons", "/a/sensor": "sensor", "/b/sensor": "sensor"},
     {"photons_topic": "/b/photons"}, ("photons", "/b/photons", "/b/sensor")),
    ({"/tof/raw": "histograms", "/image": "picture"}, {}, ("histograms", "/tof/raw", None)),
    ({"/a/sketch": "sketch", "/a/sketch/sensor": "sensor", "/b/sketch/sensor": "sensor",
      "/a/sensor": "sensor"}, {}, ("sketch", "/a/sketch", "/a/sketch/sensor")),
    ({"/sketch": "sketch", "/sketch/sensor": "sensor", "/raw": "photons"}, {"photons_topic": "/sketch"},
     ("sketch", "/sketch", "/sketch/sensor"))])
def test_the_photons_are_found_under_whatever_name(tmp_path, topics, given, found):
    with Bag(with_topics(tmp_path / "bag", topics)) as opened:
        place = find_photons(opened, **given)
    assert (place.output, place.frames.name, place.sensor and place.sensor.name) == found


@pytest.mark.parametrize("topics, given, words", [
    ({}, {}, ["bag bag has no topics of photons", "It has no messages"]),
    ({"/a/photons": "photons", "/b/gates": "gates"}, {},
     ["has 2 topics of photons", "--photons-topic", f"/a/photons ({CLOUD}, 1), /b/gates ({IMAGE}, 1)"]),
    ({"/photons": "photons"}, {"photons_topic": "/raw"}, ["photons_topic is /raw", "/photons"]),
    ({"/photons": "photons", "/x": "sensor", "/y": "sensor"}, {}, ["has 2 topics of sensor", "/x", "/y"])])
def test_what_cannot_be_told_apart_is_listed(tmp_path, topics, given, words):
    with Bag(with_topics(tmp_path / "bag", topics)) as opened, pytest.raises(InvalidInput) as error:
        find_photons(opened, **given)
    assert all(word in str(error.value) for word in words), error.value


def test_a_message_that_a_database_computes_takes_no_gigabyte(tmp_path):
    path = storage_file(write_bag(tmp_path / "bag", RECORDED, "sqlite3"))
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("ALTER TABLE messages RENAME COLUMN data TO stored")
        database.execute("ALTER TABLE messages ADD COLUMN data BLOB AS (zeroblob(300000000))")
    with pytest.raises(InvalidInput, match="bag is unreadable .*too big"):
        read(tmp_path / "bag")


@pytest.mark.parametrize("kind", ["photons", "gates", "histograms", "sketch"])
def test_a_bag_without_a_description_takes_the_given_sensor(tmp_path, kind):
    bag = with_topics(tmp_path / "bag", {f"/{kind}": kind})
    described = with_topics(tmp_path / "described", {f"/{kind}": kind, "/sensor": "sensor"})
    given, recorded = read(bag, sensor=SENSOR), read(described)
    assert given.notes == () and given.sensor.same_as(recorded.sensor)
    overridden = read(described, sensor=SENSOR)
    assert overridden.notes == () and overridden.sensor.same_as(recorded.sensor)        # with the cycles of gates
    assert given.reconstruct().xyz.tolist() == recorded.reconstruct().xyz.tolist()
    with pytest.raises(InvalidInput, match=f"no description of the sensor beside /{kind}: .*--sensor-file.*sensor="):
        read(bag)
    if kind == "photons":
        seen = read(bag, shape=(2, 3), num_bins=50, irf=[1, 2, 1], gate=(5, 49))
        assert seen.notes[:2] == (ASSUMED_WIDTH, ASSUMED_FOV) and seen.events.toa.tolist() == [2, 4]
