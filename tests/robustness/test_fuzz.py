"""Damaged input of every fuzz target: it is read, or refused in one line, and nothing else."""

import random
import sys

import pytest

from robustness import targets

TARGETS = targets.targets()
FEW = {"rrd": 2, "hdf5": 2, "mat": 3, "parameters": 10}      # inputs: they start processes, or nodes
USUALLY = 60


@pytest.mark.parametrize("name", TARGETS)
def test_damaged_input_is_read_or_refused_in_one_line(name):
    read, examples = TARGETS[name].make()
    assert all(targets.try_input(name, read, example) for example in examples)
    for number in range(FEW.get(name, USUALLY)):
        targets.try_input(name, read, targets.damaged(examples, random.Random(number)))


def test_whatever_else_a_target_does_is_a_defect(monkeypatch):
    monkeypatch.setattr(targets, "MAX_SECONDS", 0.05)

    def refuse(raw):
        raise targets.InvalidInput("a", "b", "c")

    def grow(raw):
        kept.append(b"x" * (targets.MAX_GROWTH_KB * 1024 + 2**29))

    def work(raw):
        sum(range(20_000_000))

    kept = []
    assert not targets.try_input("bad", refuse, b"x") and targets.try_input("bad", lambda raw: None, b"x")
    for read in (lambda raw: 1 / 0, sys.exit, work, grow):
        with pytest.raises(targets.Defect):
            targets.try_input("bad", read, b"x")
