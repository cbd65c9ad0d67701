"""A user's mistake is one printable line, whatever was in the input."""

import tracemalloc

import pytest

from srt3d_ros.errors import InvalidInput, quoted, require


def said(field: str, value: object, expected: str = "something else") -> str:
    return str(InvalidInput(field, value, expected))


@pytest.mark.parametrize(("field", "value", "begins"), [
    ("toa", -1, "toa is -1: expected something else"), ("device", "gpu", "device is gpu: "),
    ("shape", (3, 4), "shape is (3, 4): "), ("rows", quoted("3"), 'rows is "3": '),
    ("rows", quoted(3.5), "rows is 3.5: "),
    ("key", quoted("x" * 10_000), 'key is "xxx'), ("key", quoted(""), 'key is "": '), ("irf", "", "irf is empty: "),
    ("irf", "  ", "irf is empty: "), ("irf", "\n", "irf is empty: "),
    ("photon file", "Gerät 光.npz", "photon file is Gerät 光.npz: ")])
def test_the_line_names_field_value_and_what_was_expected(field, value, begins):
    assert said(field, value).startswith(begins)


def test_the_parts_can_be_read_from_the_exception():
    error = InvalidInput("toa", -1, "bins in [0, 10)")
    assert (error.field, error.value, error.expected) == ("toa", -1, "bins in [0, 10)")
    assert isinstance(error, ValueError)


@pytest.mark.parametrize("value", ["x" * 10_000, list(range(10_000)), b"y" * 10_000])
def test_long_values_are_shortened(value):
    line = said("value", value, "less")
    assert len(line) <= len("value is : expected less") + 80 and "..." in line


def test_a_long_path_is_shortened_in_the_middle():
    assert said("file", f"/home/{'folder/' * 20}photons.npz").endswith("/photons.npz: expected something else")
    assert said("file", f"/home/{'folder/' * 20}photons.npz").startswith("file is /home/folder/")


@pytest.mark.parametrize("part", ["field", "value", "expected"])
@pytest.mark.parametrize("broken", ["a\nb", "a\r\nb", "a\u2028b", "a\x0bb", "a\x85b", "a\tb"])
def test_line_breaks_and_tabs_become_a_space(part, broken):
    parts = {"field": "f", "value": "v", "expected": "e"} | {part: broken}
    line = said(**parts)
    assert len(line.splitlines()) == 1 and "a b" in line


@pytest.mark.parametrize("part", ["field", "value", "expected"])
@pytest.mark.parametrize(("control", "shown"), [
    ("\x1b[31m", "\\x1b[31m"), ("\x07", "\\x07"), ("\x00", "\\x00"), ("\x7f", "\\x7f"), ("\x9b2J", "\\x9b2J"),
    ("\u202e", "\\u202e"), ("\udcff", "\\udcff"), ("\b", "\\x08")])
def test_control_characters_do_not_reach_the_terminal(part, control, shown):
    parts = {"field": "f", "value": "v", "expected": "e"} | {part: f"a{control}b"}
    line = said(**parts)
    assert line.isprintable() and f"a{shown}b" in line
    line.encode()


@pytest.mark.parametrize("value", ["x" * 36 + "\x1b" * 20 + "y" * 90, "x" * 90 + "\x1b" * 20 + "y" * 36])
def test_a_shortened_value_has_no_half_of_an_escape(value):
    line = said("value", value)
    head, tail = line.removeprefix("value is ").removesuffix(": expected something else").split("...")
    assert line.isprintable() and set(head.removeprefix("x" * 36).split("\\x1b")) <= {"", "x" * 2}
    assert set(tail.removesuffix("y" * 36).split("\\x1b")) <= {"", "y" * 2}


def test_require_raises_only_if_the_condition_fails():
    require(True, "rows", 1, "more")
    with pytest.raises(InvalidInput, match="^rows is 0: expected more$"):
        require(False, "rows", 0, "more")


def test_values_of_many_words_are_shortened_as_if_they_had_been_joined():
    assert said("value", "a  " * 10**6) == f"value is {'a ' * 19}...{' a' * 19}: expected something else"


@pytest.mark.parametrize("part", ["field", "expected"])
def test_a_line_stays_a_line_whatever_the_input_has_of_it(part):
    parts = {"field": "array", "value": 3, "expected": "one of a, b"} | {part: "name, " * 10**6}
    assert len(said(**parts)) < 1000


def nested(depth: int) -> list:
    value = []
    for _ in range(depth):
        value = [value]
    return value


@pytest.mark.parametrize("value", [nested(100_000), {"a": nested(100_000)}, (nested(100_000),)], ids=type)
def test_brackets_deeper_than_the_interpreter_goes_are_shown(value):
    assert "[[[[" in said("irf", value) and "..." in said("irf", value)


@pytest.mark.parametrize("value", [bytes(10**7), [0.5] * 10**7], ids=type)
def test_a_large_value_is_not_written_out_to_show_its_ends(value):
    tracemalloc.start()
    said("frame_id", value)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100_000
