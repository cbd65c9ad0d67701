"""Damaged input for readers of bytes, and the graph of real nodes."""

import re
from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from srt3d_ros.errors import InvalidInput
from tests.nodes.conftest import events, photons_at, sensor, shared_graph  # noqa: F401

NUMBERS = (0, 1, 255, 2**15, 2**16 - 1, 2**16, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1)
TEXTS = (b"nan", b"-inf", b"1e999", b"-1", b"0", b"9" * 400, b"null", b"[", b"{}", b'""', b"\xff", b"\0", b"\r\n")
NUMBER_AS_TEXT = re.compile(rb"-?\d[\d.]*(?:[eE][+-]?\d+)?")


@pytest.fixture(scope="session")
def rounds(pytestconfig) -> int:
    """The number of inputs to try (--rounds)."""
    return pytestconfig.getoption("rounds")


@st.composite
def damaged(draw, examples: list[bytes]) -> bytes:
    """One of the examples with one to four changes: of bits, bytes, or numbers in binary or as text."""
    raw = bytearray(draw(st.sampled_from(examples)))
    for _ in range(draw(st.integers(1, 4))):
        at, length = draw(st.integers(0, len(raw))), draw(st.integers(1, 8))
        match draw(st.sampled_from(("flip", "cut", "remove", "insert", "copy", "number", "text"))):
            case "flip":
                raw[at:at + 1] = bytes(byte ^ 1 << length - 1 for byte in raw[at:at + 1])
            case "cut":
                del raw[at:]
            case "remove":
                del raw[at:at + length]
            case "insert":
                raw[at:at] = draw(st.binary(min_size=length, max_size=length))
            case "copy":
                other = draw(st.sampled_from(examples))
                raw[at:at + 8 * length] = other[at:at + 8 * draw(st.integers(1, 8))]
            case "number":
                width = draw(st.sampled_from((1, 2, 4, 8)))
                at -= at % width
                raw[at:at + width] = draw(st.sampled_from(NUMBERS)).to_bytes(8, "little")[:width]
            case "text":
                if found := NUMBER_AS_TEXT.search(raw, at):
                    raw[found.start():found.end()] = draw(st.sampled_from(TEXTS))
    return bytes(raw)


def read_or_refused(read: Callable[[bytes], object], examples: list[bytes], rounds: int) -> None:
    """Check that `read` reads the examples, and reads or refuses in one line what has been damaged.

    Any other exception fails; hypothesis then shows the smallest input that raises it.
    """
    for example in examples:
        read(example)

    @settings(max_examples=rounds, deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(damaged(examples))
    def try_damaged(raw: bytes) -> None:
        try:
            read(raw)
        except InvalidInput as refusal:
            assert len(str(refusal).splitlines()) == 1

    try_damaged()
