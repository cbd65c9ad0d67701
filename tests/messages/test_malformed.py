"""Messages that break the contract: each gives exactly one error, in one line, that names the field."""

import struct
import tracemalloc

import numpy as np
import pytest
from sensor_msgs.msg import PointField

from srt3d_ros.core.sensor import GateWords
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import gates, histograms, photons, sketch


def field(which: str, **changes):
    """Change a PointField."""
    def change(message):
        chosen = next(field for field in message.fields if field.name == which)
        for key, value in changes.items():
            setattr(chosen, key, value)
    return change


def put(**changes):
    """Change parts of the message."""
    def change(message):
        for key, value in changes.items():
            setattr(message, key, value)
    return change


def drop(name: str):
    """Take a PointField away."""
    def change(message):
        message.fields = [field for field in message.fields if field.name != name]
    return change


def double(name: str):
    """Give a PointField twice."""
    def change(message):
        message.fields = [*message.fields, next(field for field in message.fields if field.name == name)]
    return change


def write(name: str, value, kind: str):
    """Write a number into the first point."""
    def change(message):
        offset = next(field.offset for field in message.fields if field.name == name)
        data = bytearray(message.data)
        struct.pack_into(kind, data, offset, value)
        message.data = bytes(data)
    return change


def cut(count: int):
    """Take bytes off the end of the data."""
    def change(message):
        message.data = bytes(message.data)[:-count]
    return change


def first_word(word: float, kind: str = "<H"):
    """Overwrite the first number of an image."""
    def change(message):
        message.data = struct.pack(kind, word) + bytes(message.data)[struct.calcsize(kind):]
    return change


NAN, INF = float("nan"), float("inf")
MALFORMED = [
    ("photons_uint16", "row is missing", drop("row"), "row"),
    ("photons_uint16", "toa is missing", drop("toa"), "toa"),
    ("photons_uint16", "no fields", put(fields=[]), "row"),
    ("photons_uint16", "toa twice", double("toa"), "toa"),
    ("photons_uint16", "field name in capitals", field("col", name="COL"), "col"),
    ("photons_uint16", "col of a wrong type", field("col", datatype=PointField.INT16), "col datatype"),
    ("photons_uint16", "row of an unknown type", field("row", datatype=99), "row datatype"),
    ("photons_float32", "toa as float64", field("toa", datatype=PointField.FLOAT64), "toa datatype"),
    ("photons_uint16", "count 0", field("row", count=0), "row count"),
    ("photons_uint16", "count 2", field("toa", count=2), "toa count"),
    ("photons_uint16", "fields overlap", field("toa", offset=3), "toa offset"),
    ("photons_uint16", "offset beyond the point", field("toa", offset=5), "toa offset"),
    ("photons_uint16", "offset of 4 GB", field("toa", offset=2**32 - 2), "toa offset"),
    ("photons_uint16", "point_step too small", put(point_step=5), "toa offset"),
    ("photons_uint16", "point_step too large for row_step", put(point_step=7), "row_step"),
    ("photons_uint16", "point_step of 4 GB", put(point_step=2**32 - 1), "point_step"),
    ("photons_uint16", "row_step too small", put(row_step=17), "row_step"),
    ("photons_uint16", "row_step beyond the data", put(row_step=19), "data"),
    ("photons_uint16", "height 2", put(height=2), "height"),
    ("photons_uint16", "height 0", put(height=0), "height"),
    ("photons_uint16", "more photons than data", put(width=4), "row_step"),
    ("photons_uint16", "2³² photons", put(width=2**32 - 1), "row_step"),
    ("photons_uint16", "data cut", cut(1), "data"),
    ("photons_uint16", "no data", put(data=b""), "data"),
    ("photons_uint16", "row outside the sensor", write("row", 3, "<H"), "row"),
    ("photons_uint16", "col outside the sensor", write("col", 4, "<H"), "col"),
    ("photons_uint16", "big-endian data not said to be", write("row", 1, ">H"), "row"),
    ("photons_uint16", "toa beyond the last bin", write("toa", 100, "<H"), "toa"),
    ("photons_uint32", "toa of 2³²", write("toa", 2**32 - 1, "<I"), "toa"),
    ("photons_float32", "toa NaN", write("toa", NAN, "<f"), "toa"),
    ("photons_float32", "toa infinite", write("toa", INF, "<f"), "toa"),
    ("photons_float32", "toa negative", write("toa", -0.5, "<f"), "toa"),
    ("photons_float32", "toa equal to T", write("toa", 100.0, "<f"), "toa"),
    ("photons_uint16_t", "t in seconds", field("t", datatype=PointField.FLOAT32), "t datatype"),
    ("photons_float32_t", "t as float64", field("t", datatype=PointField.FLOAT64), "t datatype"),
    ("photons_uint16_t", "t twice", double("t"), "field t"),
    ("photons_uint16_t", "two t a photon", field("t", count=2), "t count"),
    ("photons_uint16_t", "t over toa", field("t", offset=6), "toa offset"),
    ("photons_uint32_t", "t a nanosecond before the stamp", write("t", 2**32 - 1, "<I"), "t"),
    ("photons_float32_t", "t absurdly long", write("t", 4_000_000_001, "<I"), "t"),
    ("gates", "wrong encoding", put(encoding="mono8"), "encoding"),
    ("gates", "no encoding", put(encoding=""), "encoding"),
    ("gates", "is_bigendian 2", put(is_bigendian=2), "is_bigendian"),
    ("gates", "width not the sensor's", put(width=3), "width"),
    ("gates", "height no multiple of the rows", put(height=5), "height"),
    ("gates", "step too small", put(step=7), "step"),
    ("gates", "data cut", cut(2), "data"),
    ("gates", "word below first_word", first_word(9), "gates word"),
    ("gates", "word above the last bin", first_word(110), "gates word"),
    ("histograms_16UC5", "a camera's encoding", put(encoding="rgb8"), "encoding"),
    ("histograms_16UC5", "signed, but too narrow", put(encoding="16SC5"), "encoding"),
    ("histograms_16UC5", "too many bins", put(encoding="16UC6"), "encoding"),
    ("histograms_16UC5", "too few bins", put(encoding="16UC4"), "encoding"),
    ("histograms_16UC5", "no number of bins", put(encoding="16UC"), "encoding"),
    ("histograms_16UC5", "wider than said", put(encoding="8UC5", step=20), "data"),
    ("histograms_16UC5", "height not the sensor's", put(height=2), "height"),
    ("histograms_16UC5", "no rows", put(height=0, data=b""), "height"),
    ("histograms_16UC5", "width not the sensor's", put(width=5), "width"),
    ("histograms_16UC5", "width of 4 GB", put(width=2**32 - 1), "width"),
    ("histograms_16UC5", "step too small", put(step=39), "step"),
    ("histograms_16UC5", "step of 4 GB", put(step=2**32 - 1), "data"),
    ("histograms_16UC5", "data cut", cut(1), "data"),
    ("histograms_16UC5", "no data", put(data=b""), "data"),
    ("histograms_32FC5", "count NaN", first_word(NAN, "<f"), "histograms count"),
    ("histograms_32FC5", "count infinite", first_word(-INF, "<f"), "histograms count"),
    ("histograms_32FC5", "count that no sum can hold", first_word(1e12, "<f"), "histograms count"),
    ("histograms_32SC5", "count that no sum can hold", first_word(-2**30, "<i"), "histograms count"),
    ("sketch_float32", "photons missing", drop("photons"), "photons"),
    ("sketch_float32", "photons as float32", field("photons", datatype=PointField.FLOAT32), "photons datatype"),
    ("sketch_float32", "sketch missing", drop("sketch"), "sketch"),
    ("sketch_float32", "sketch of another m", field("sketch", count=2), "sketch count"),
    ("sketch_float32", "sketch as float64", field("sketch", datatype=PointField.FLOAT64), "sketch datatype"),
    ("sketch_float32", "sketch over photons", field("sketch", offset=3), "sketch offset"),
    ("sketch_float32", "height not the sensor's", put(height=4), "height"),
    ("sketch_float32", "width not the sensor's", put(width=3), "width"),
    ("sketch_float32", "data cut", cut(1), "data"),
    ("sketch_float32", "z NaN", write("sketch", NAN, "<f"), "sketch"),
    ("sketch_float32", "z infinite", write("sketch", -INF, "<f"), "sketch"),
    ("sketch_float32", "z longer than 1", write("sketch", 1.01, "<f"), "sketch"),
    ("points_xyzi", "intensity missing", drop("intensity"), "intensity"),
    ("points_xyzi", "x as float64", field("x", datatype=PointField.FLOAT64), "x datatype"),
    ("points_full", "row as uint32", field("row", datatype=PointField.UINT32), "row datatype"),
    ("points_full", "data cut", cut(32), "data"),
    ("image_32FC1", "wrong encoding", put(encoding="64FC1"), "encoding"),
    ("image_32FC1", "data cut", cut(4), "data"),
]


@pytest.mark.parametrize(("codec_name", "change", "named"), [(name, *rest) for name, _, *rest in MALFORMED],
                         ids=[f"{name}: {what}" for name, what, *_ in MALFORMED], indirect=["codec_name"])
def test_malformed_message_gives_one_error_that_names_the_field(codec, change, named):
    message = codec.message()
    change(message)
    with pytest.raises(InvalidInput) as caught:
        codec.decode(message)
    assert caught.value.field in (named, f"field {named}")
    assert len(str(caught.value).splitlines()) == 1 and ": expected " in str(caught.value)


def test_stamp_that_is_no_time_is_refused(codec):
    message = codec.message()
    message.header.stamp.nanosec = 10**9
    with pytest.raises(InvalidInput, match="^header.stamp.nanosec is 1000000000: "):
        codec.decode(message)


BAD_CDR = [
    ("empty", lambda raw: b"", "CDR header"),
    ("CDR of mutable types", lambda raw: b"\x00\x03" + raw[2:], "CDR header"),
    ("text", lambda raw: b"hello there", "CDR header"),
    ("header alone", lambda raw: raw[:4], "header.stamp.sec"),
    ("frame_id longer than the message", lambda raw: raw[:12] + b"\xff\xff\xff\xff" + raw[16:], "header.frame_id"),
    ("frame_id without its NUL", lambda raw: raw.replace(b"lidar\0", b"lidar!"), "header.frame_id"),
    ("frame_id not UTF-8", lambda raw: raw.replace(b"lidar\0", b"lid\xff\xff\0"), "header.frame_id"),
    ("2³² fields", lambda raw: raw[:32] + b"\xff\xff\xff\xff" + raw[36:], "fields"),
    ("row's name longer than the message", lambda raw: raw[:36] + b"\x00\x00\x00\x80" + raw[40:], "fields.name"),
    ("is_dense 2", lambda raw: raw[:-1] + b"\x02", "is_dense"),
    ("twice in one", lambda raw: raw + raw, "message"),
]


@pytest.mark.parametrize(("change", "named"), [case[1:] for case in BAD_CDR], ids=[case[0] for case in BAD_CDR])
def test_bad_cdr_gives_one_error_that_names_the_field(codecs, change, named):
    codec = codecs["photons_uint16"]
    with pytest.raises(InvalidInput) as caught:
        codec.decode_cdr(change(codec.encode_cdr()))
    assert caught.value.field == named


def test_hostile_sizes_allocate_nothing(codecs):
    codec = codecs["photons_uint16"]
    raw = codec.encode_cdr()
    hostile = [raw[:at] + b"\xff\xff\xff\xff" + raw[at + 4:] for at in range(4, len(raw) - 4, 4)]
    tracemalloc.start()
    for message in hostile:
        try:
            codec.decode_cdr(message)
        except InvalidInput:
            pass
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100_000


def test_gates_need_the_sensors_words(codecs, small_sensor):
    with pytest.raises(InvalidInput, match="^sensor.gates is missing"):
        gates.decode_cdr(codecs["gates"].encode_cdr(), small_sensor.replace(gates=None))


def test_word_that_would_wrap_around_16_bits_is_refused(codecs, small_sensor):
    sensor = small_sensor.replace(gates=GateWords(first_word=65_500, no_detection=0))
    header = codecs["gates"].encode_cdr()[:-48]
    full, wrapped = (header + np.full(24, word, "<u2").tobytes() for word in (65_535, 63))
    assert gates.decode_cdr(full, sensor)[1].words[0, 0, 0] == 65_535
    with pytest.raises(InvalidInput, match="^gates word is 63: expected 65500 to 65535"):
        gates.decode_cdr(wrapped, sensor)           # (63 − 65500) mod 2¹⁶ = 99, a bin if one forgot


def test_content_that_breaks_the_contract_is_not_written(codecs, small_sensor):
    events = codecs["photons_uint16"].content
    with pytest.raises(InvalidInput, match="^toa is 99"):
        photons.encode_cdr(events, small_sensor.replace(num_bins=99), "lidar")
    with pytest.raises(InvalidInput, match="^pixel is 11"):
        photons.encode_cdr(events, small_sensor.replace(rows=2), "lidar")
    with pytest.raises(InvalidInput, match="^gates shape"):
        gates.encode_cdr(codecs["gates"].content, small_sensor.replace(rows=6), "lidar")
    with pytest.raises(InvalidInput, match="^gates word is 33"):
        gates.encode_cdr(codecs["gates"].content, small_sensor.replace(num_bins=23), "lidar")
    with pytest.raises(InvalidInput, match="^histograms shape"):
        histograms.encode_cdr(codecs["histograms_8UC5"].content, small_sensor.replace(histograms=None), "lidar")
    whole = codecs["sketch_float32"].content
    with pytest.raises(InvalidInput, match="^sketch is nan"):
        sketch.encode_cdr(type(whole)(whole.frequencies, whole.sums * np.float32(NAN), whole.photons), "lidar")
    with pytest.raises(InvalidInput, match="^layout is float64: expected float32 or int16 or coded"):
        sketch.encode_cdr(whole, "lidar", "float64")
