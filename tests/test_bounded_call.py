"""A function in a child process: its arrays come back; whatever ends the child is one line, and no trace of it."""

import os
import signal
import sys

import numpy as np
import pytest

from srt3d_ros.bounded_call import ChildFailed, call
from srt3d_ros.errors import InvalidInput

MEGABYTE = 2**20
ARRAYS = {"counts": np.arange(6, dtype=np.uint16).reshape(2, 3), "columns": np.asfortranarray(np.eye(3)[:2]),
          "none": np.zeros((0, 4), np.float32), "one": np.array(7), "MM": np.ones(1), "mm": np.zeros(1)}


def arrays(*names):
    return {name: ARRAYS[name] for name in names}


def end(how):
    """End this process in one of these ways, or try to."""
    os.write(2, b"a library's complaint\n")
    if how == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    elif how.startswith("exit"):
        os._exit(int(how[-1]))
    elif how == "memory":
        return {"zeros": np.ones(300 * MEGABYTE, np.uint8)}
    elif how == "hang":
        while True:
            pass
    elif how == "refuse":
        raise InvalidInput("mask", [1, "a"], "a mask")
    elif how == "raise":
        raise KeyError("two\nlines")
    elif how == "absent":
        raise ModuleNotFoundError("No module named 'h5py'", name="h5py")
    elif how == "Ctrl-C":
        os.kill(os.getpid(), signal.SIGINT)
    return {"survived": np.ones(1)}


def say(words):
    print(words, flush=True)
    print(words, file=sys.stderr)
    os.write(2, b"past Python\n")
    return {}


def test_arrays_come_back_as_they_were():
    found = call(arrays, *ARRAYS)
    assert list(found) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


@pytest.mark.parametrize(("how", "why"), [
    ("crash", "ended with SIGSEGV"), ("exit 0", "ended with exit code 0"),
    ("hang", "takes longer than 3 s"), ("memory", "takes more than 0.195 GiB of memory"),
    ("raise", r"failed: KeyError: 'two\nlines'")])
def test_whatever_ends_a_child_is_one_line(how, why, capfd):
    with pytest.raises(ChildFailed) as caught:
        call(end, how, memory_bytes=200 * MEGABYTE, timeout_s=3 if how == "hang" else 60)
    assert str(caught.value) == why
    assert capfd.readouterr() == ("", "")


def test_what_the_function_refuses_is_refused_here():
    with pytest.raises(InvalidInput) as caught:
        call(end, "refuse")
    assert (caught.value.field, caught.value.value, caught.value.expected) == ("mask", [1, "a"], "a mask")
    with pytest.raises(ModuleNotFoundError) as caught:
        call(end, "absent")
    assert caught.value.name == "h5py"
    with pytest.raises(KeyboardInterrupt):
        call(end, "Ctrl-C")


def test_what_the_function_says_is_heard_and_what_libraries_say_is_not(capfd):
    assert call(say, "words") == {}
    assert capfd.readouterr() == ("words\n", "words\n")


def test_no_module_is_taken_from_the_working_directory(tmp_path, monkeypatch):
    for name in ("json", "numpy", "srt3d_ros"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('a stranger')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place])
    assert call(arrays, "one")["one"] == 7
