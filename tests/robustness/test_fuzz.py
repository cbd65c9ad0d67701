"""Damaged input of every fuzz target: it is read, or refused in one line, and nothing else."""

import sys

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robustness import targets

TARGETS = targets.targets()
TOO_SLOW = {"rrd_repair", "command_line", "kernels"}        # for here: they start processes, compile kernels
FEW = {"rrd": 4, "mat": 8, "mat_compressed": 8, "parameters": 10}      # inputs: they start processes, or nodes
USUALLY = 60
NUMBERS = [0, 1, 255, 2**15, 2**16 - 1, 2**16, 2**24, 2**31 - 1, 2**31, 2**32 - 1]


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


@pytest.mark.parametrize("name", [name for name in TARGETS if name not in TOO_SLOW])
def test_damaged_input_is_read_or_refused_in_one_line(name):
    target = TARGETS[name]
    read, examples = target.make()
    examples = list(examples)
    assert all(targets.try_input(target, read, example) for example in examples)

    @settings(max_examples=FEW.get(name, USUALLY), deadline=None, derandomize=True, database=None,
              suppress_health_check=list(HealthCheck))
    @given(damaged(examples))
    def fuzz(raw: bytes):
        targets.try_input(target, read, raw)

    fuzz()


def test_whatever_else_a_target_does_is_a_defect():
    def try_target(read):
        return targets.try_input(targets.Target("bad", lambda: (read, []), seconds=0.05), read, b"x")

    def refuse(line):
        def read(raw):
            raise targets.InvalidInput("a", "b", line)
        return read

    def grow(raw):
        kept.append(b"x" * (targets.MAX_GROWTH_KB * 1024 + 2**29))

    def work(raw):
        sum(range(20_000_000))

    kept = []
    assert not try_target(refuse("c")) and try_target(lambda raw: None)
    for read in (lambda raw: 1 / 0, sys.exit, work, grow):
        with pytest.raises(targets.Defect):
            try_target(read)
