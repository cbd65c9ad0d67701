"""Messages that break the contract: each gives exactly one error, in one line, that names the field."""

import contextlib
import dataclasses
import tracemalloc

import numpy as np
import pytest

from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import photon_frames
from srt3d_ros.messages import sketch_message as sketch
from srt3d_ros.messages.photon_frames import GATES as gates
from srt3d_ros.messages.photon_frames import HISTOGRAMS as histograms
from tests.messages.conftest import CODECS, SENSOR

INT16, FLOAT64 = 3, 8         # of PointField's datatypes


def change(message, what: str, value) -> None:
    """Change "attribute" of a message, "field.attribute" of one of its fields, or a field's number in the first point.

    "field.times" is how often the field is there, "data.end" how many bytes are cut off.
    """
    name, _, attribute = what.partition(".")
    field = next((field for field in getattr(message, "fields", ()) if field.name == name), None)
    data = bytes(message.data)
    if name == "data":
        message.data = data[:-value]
    elif attribute == "times":
        message.fields = [other for other in message.fields if other is not field] + value * [field]
    elif attribute == "number":
        message.data = data[:field.offset] + value.tobytes() + data[field.offset + value.itemsize:]
    else:
        setattr(field or message, attribute or what, value)


@pytest.mark.parametrize(("codec_name", "what", "value", "named"), [
    ("photons_uint16", "row.times", 0, "row"),
    ("photons_uint16", "toa.times", 2, "toa"),
    ("photons_uint16", "col.datatype", INT16, "col datatype"),
    ("photons_uint16", "toa.count", 2, "toa count"),
    ("photons_uint16", "toa.offset", 3, "toa offset"),
    ("photons_uint16", "toa.offset", 5, "toa offset"),
    ("photons_uint16", "toa.offset", 2**32 - 2, "toa offset"),
    ("photons_uint16", "point_step", 2**32 - 1, "point_step"),
    ("photons_uint16", "row_step", 17, "row_step"),
    ("photons_uint16", "height", 2, "data"),
    ("photons_uint16", "data.end", 1, "data"),
    ("photons_uint16", "row.number", np.uint16(3), "row"),
    ("photons_uint16", "col.number", np.uint16(4), "col"),
    ("gates", "encoding", "mono8", "encoding"),
    ("gates", "is_bigendian", 2, "is_bigendian"),
    ("gates", "width", 3, "width"),
    ("gates", "height", 5, "height"),
    ("histograms_16UC5", "encoding", "16UC6", "encoding"),
    ("histograms_16UC5", "encoding", "8UC5", "encoding"),
    ("histograms_16UC5", "width", 5, "width"),
    ("histograms_16UC5", "step", 2**32 - 1, "data"),
    ("histograms_16UC5", "data.end", 1, "data"),
    ("sketch_float32", "k3.datatype", FLOAT64, "k3 datatype"),
    ("sketch_float32", "k3.count", 1, "k3 count"),
    ("sketch_float32", "height", 4, "height"),
    ("sketch_float32", "k1.number", np.float32(np.nan), "sketch"),
    ("sketch_float32", "k1.number", np.float32(1.01), "sketch"),
    ("points_xyzi", "intensity.times", 0, "intensity"),
    ("image_32FC1", "encoding", "64FC1", "encoding"),
], indirect=["codec_name"])
def test_malformed_message_gives_one_error_that_names_the_field(codec, what, value, named):
    message = codec.message()
    change(message, what, value)
    with pytest.raises(InvalidInput) as caught:
        codec.decode(message)
    assert caught.value.field in (named, f"field {named}")
    assert len(str(caught.value).splitlines()) == 1 and ": expected " in str(caught.value)


@pytest.mark.parametrize(("change", "named"), [
    (lambda raw: b"", "CDR header"),
    (lambda raw: b"\x00\x03" + raw[2:], "CDR header"),         # of mutable types
    (lambda raw: b"\x00\x00" + raw[2:], "CDR header"),         # big-endian
    (lambda raw: raw[:4], "header.stamp.sec"),
    (lambda raw: raw[:8] + (10**9).to_bytes(4, "little") + raw[12:], "header.stamp.nanosec"),
    (lambda raw: raw[:12] + b"\xff\xff\xff\xff" + raw[16:], "header.frame_id"),
    (lambda raw: raw.replace(b"lidar\0", b"lidar!"), "header.frame_id"),
    (lambda raw: raw[:12] + b"\1\1\0\0" + b"a" * 256 + b"\0\0\0\0" + raw[24:], "header.frame_id"),
    (lambda raw: raw[:12] + b"\0\0\1\0" + b"a" * 65_535 + b"\0" + raw[24:], "header.frame_id"),
    (lambda raw: raw.replace(b"lidar\0", b"lid\xff\xff\0"), "header.frame_id"),
    (lambda raw: raw[:32] + b"\xff\xff\xff\xff" + raw[36:], "fields"),
    (lambda raw: raw[:36] + b"\x00\x00\x00\x80" + raw[40:], "fields.name"),
    (lambda raw: raw[:-1] + b"\x02", "is_dense"),
    (lambda raw: raw + raw, "message"),
])
def test_bad_cdr_gives_one_error_that_names_the_field(change, named):
    codec = CODECS["photons_uint16"]
    with pytest.raises(InvalidInput) as caught:
        codec.decode_cdr(change(codec.encode_cdr()))
    assert caught.value.field == named


def test_hostile_sizes_allocate_nothing():
    codec = CODECS["photons_uint16"]
    raw = codec.encode_cdr()
    hostile = [raw[:at] + b"\xff\xff\xff\xff" + raw[at + 4:] for at in range(4, len(raw) - 4, 4)]
    tracemalloc.start()
    for message in hostile:
        with contextlib.suppress(InvalidInput):
            codec.decode_cdr(message)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100_000


def test_content_that_breaks_the_contract_is_not_written():
    events, whole = CODECS["photons_uint16"].content, CODECS["sketch_float32"].content
    nan = dataclasses.replace(whole, sums=whole.sums * np.float32(np.nan))
    for encode, content, options, said in (
            (photon_frames.PHOTONS.encode_cdr, events, (SENSOR.replace(num_bins=99), "lidar"), "^toa is 99"),
            (gates.encode_cdr, CODECS["gates"].content, (SENSOR.replace(num_bins=23), "lidar"), "^gates word is"),
            (histograms.encode_cdr, CODECS["histograms_8UC5"].content, (SENSOR.replace(histograms=None), "lidar"),
             "^histograms shape"),
            (sketch.encode_cdr, nan, ("lidar",), "^sketch is nan")):
        with pytest.raises(InvalidInput, match=said):
            encode(content, *options)
