"""The backends have the names and arguments of the reference, whose constants need none of what they need."""

import inspect
import subprocess
import sys

import pytest

from srt3d_ros.kernels import reference


def arguments(function) -> list[tuple]:
    """Names, kinds and default values of a function's arguments."""
    return [(each.name, each.kind, each.default) for each in inspect.signature(function).parameters.values()]


@pytest.mark.parametrize("name", reference.__all__)
def test_a_backend_has_the_names_and_arguments_of_the_reference(backend, name):
    ours, theirs = (getattr(kernels, name) for kernels in (backend.kernels, reference))
    methods = {"Scratch": ["array"]}.get(name, [])
    for one, two in [(getattr(ours, method), getattr(theirs, method)) for method in methods] or [(ours, theirs)]:
        if callable(two):
            assert arguments(one) == arguments(two)
    assert type(ours) is type(theirs) and (not callable(theirs) or theirs.__doc__)


def test_what_all_backends_share_needs_numpy_alone():
    names = "{'numba', 'torch', 'triton', 'srt3d_ros.core', 'srt3d_ros.errors'}"
    modules = "import sys; from srt3d_ros.kernels import constants, lens, maps"
    program = f"{modules}; sys.exit(str({names} & set(sys.modules) or ''))"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.stderr.strip() == ""
