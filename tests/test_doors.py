"""Every way in, with what it gets damaged: it is read, or refused in one line, and nothing else (scripts/attacks)."""

import sys

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

NAMES = ["photons", "gates", "sketch", "points", "images", "sensor", "sketch_sensor", "camera_info", "npz",
         "npz_member", "sidecar", "irf_npy", "irf_csv", "irf_txt", "scene", "sensor_file", "mat", "mat_compressed",
         "bag_mcap", "bag_sqlite3", "bag_metadata", "rrd", "parameters", "arguments", "cloud_name"]
TOO_SLOW = ["rrd_repair", "command_line"]       # for here: they start processes, compile kernels
FEW = {"rrd": 4, "mat": 8, "mat_compressed": 8, "parameters": 10}      # inputs: they start processes, or nodes
USUALLY = 60
NUMBERS = [0, 1, 255, 2**15, 2**16 - 1, 2**16, 2**24, 2**31 - 1, 2**31, 2**32 - 1]


@pytest.fixture(scope="session")
def fuzz(attack):
    """The module scripts/attacks/fuzz_doors.py."""
    return attack("fuzz_doors")


@st.composite
def damaged(draw, examples: list[bytes]) -> bytes:
    """An example with bytes changed, put in, left out, or with a number of 4 bytes where one may have been."""
    raw = bytearray(draw(st.sampled_from(examples)))
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(raw)))
        how = draw(st.sampled_from(("flip", "cut", "insert", "leave out", "number")))
        if how == "flip" and at < len(raw):
            raw[at] ^= 1 << draw(st.integers(0, 7))
        elif how == "cut":
            del raw[max(at, len(raw) // 2):]
        elif how == "insert":
            raw[at:at] = draw(st.binary(min_size=1, max_size=8))
        elif how == "leave out":
            del raw[at:at + draw(st.integers(1, 8))]
        elif how == "number":
            raw[at - at % 4:at - at % 4 + 4] = draw(st.sampled_from(NUMBERS)).to_bytes(4, "little")
    return bytes(raw)


@pytest.mark.parametrize("name", NAMES)
def test_whatever_comes_is_read_or_refused_in_one_line(fuzz, name):
    door = fuzz.doors()[name]
    read, examples = door.make()
    examples = list(examples)
    assert all(fuzz.knock(door, read, example) for example in examples)

    @settings(max_examples=FEW.get(name, USUALLY), deadline=None, derandomize=True, database=None,
              suppress_health_check=list(HealthCheck))
    @given(damaged(examples))
    def attack(raw: bytes):
        fuzz.knock(door, read, raw)

    attack()


def test_the_test_knows_every_door(fuzz):
    assert {*NAMES, *TOO_SLOW} == set(fuzz.doors())


def test_a_door_that_fails_is_a_defect(fuzz):
    def door_of(read):
        return fuzz.knock(fuzz.Door("bad", lambda: (read, []), seconds=0.05), read, b"x")

    def refuse(line):
        def read(raw):
            raise fuzz.InvalidInput("a", "b", "c" * line)
        return read

    def grow(raw):
        kept.append(b"x" * (fuzz.MAX_GROWTH_KB * 1024 + 2**29))

    def work(raw):
        sum(range(20_000_000))

    kept = []
    assert not door_of(refuse(1)) and door_of(lambda raw: None)
    for read in (lambda raw: 1 / 0, sys.exit, work, grow):
        with pytest.raises(fuzz.Defect):
            door_of(read)
