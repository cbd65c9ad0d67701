"""Readers without the process that isolates SciPy and h5py."""

import pytest

from srt3d_ros.files import isolated, isolated_child
from srt3d_ros.files.array_files import read_errors


@pytest.fixture
def in_this_process(monkeypatch):
    """Without the child, which takes as long as its library to start: tests/files/test_isolated.py is with it."""
    def arrays_of(path, library, names, expected):
        with read_errors(path, expected):
            arrays, listed = isolated_child.READERS[library][1](path, names)
        return arrays, isolated_child.listing(listed)
    monkeypatch.setattr(isolated, "arrays_of", arrays_of)
