"""A user's mistake is one printable line, whatever was in the input."""

import pickle
from functools import reduce

import pytest

from srt3d_ros.errors import InvalidInput, quoted, require


def said(field: str, value: object, expected: str = "something else") -> str:
    return str(InvalidInput(field, value, expected))


@pytest.mark.parametrize(("field", "value", "begins"), [
    ("toa", -1, "toa is -1: expected something else"), ("photon file", "Gerät 光.npz", "photon file is Gerät 光.npz: "),
    ("shape", (3, 4), "shape is (3, 4): "), ("rows", quoted("3"), 'rows is "3": '),
    ("rows", quoted(3.5), "rows is 3.5: "), ("key", quoted(""), 'key is "": '), ("irf", " \n", "irf is empty: ")])
def test_the_line_names_field_value_and_what_was_expected(field, value, begins):
    assert said(field, value).startswith(begins)
    with pytest.raises(InvalidInput) as caught:
        require(False, field, value, "something else")
    assert (caught.value.field, caught.value.value, caught.value.expected) == (field, value, "something else")
    require(True, field, value, "something else")


def test_a_sentence_is_the_whole_line_and_keeps_its_field():
    error = InvalidInput("frame", problem="log.json has no frame 9\n(it has 8).")
    assert (str(error), error.field) == ("log.json has no frame 9 (it has 8).", "frame")
    assert str(error.within("scan.zip")) == "scan.zip: log.json has no frame 9 (it has 8)."
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
    with pytest.raises(InvalidInput, match="^no frame$"):
        require(False, "frame", problem="no frame")
    assert len(str(InvalidInput("frame", problem="name, " * 10**6))) < 1000


DEEP = reduce(lambda inner, _: [inner], range(100_000), [])        # deeper than the interpreter goes


@pytest.mark.parametrize("value", ["x" * 10_000, list(range(10_000)), b"y" * 10_000, "a  " * 10**6, DEEP])
def test_long_values_are_shortened_in_the_middle(value):
    line = said("value", value, "less")
    assert len(line) <= len("value is : expected less") + 80 and "..." in line
    assert said("file", f"/home/{'folder/' * 20}photons.npz").endswith("/photons.npz: expected something else")


@pytest.mark.parametrize("part", ["field", "value", "expected"])
@pytest.mark.parametrize(("given", "shown"), [
    ("a\nb\r\nc\u2028d\x0be\x85f\tg", "a b c d e f g"),
    ("a\x1b[31m\x00\x9b2J\u202e\udcff\bb", "a\\x1b[31m\\x00\\x9b2J\\u202e\\udcff\\x08b")], ids=["breaks", "controls"])
def test_line_breaks_and_tabs_become_a_space_and_control_characters_do_not_reach_the_terminal(part, given, shown):
    line = said(**{"field": "f", "value": "v", "expected": "e"} | {part: given})
    assert line.isprintable() and shown in line
    line.encode()
