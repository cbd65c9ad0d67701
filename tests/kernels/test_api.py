"""The backends have the names and arguments of the contract, and its module needs none of what they need."""

import inspect
import subprocess
import sys
from importlib import import_module

import pytest

from srt3d_ros.kernels import api

KERNELS = {name: value for name, value in vars(api.Kernels).items() if inspect.isfunction(value)
           and not name.startswith("_")}
CLASSES = {name: getattr(api, name) for name in ("Scratch", "FrameStream")}
CONSTANTS = set(api.Kernels.__annotations__) - set(CLASSES)


@pytest.fixture(params=["reference", "cpu", "cuda"])
def backend(request):
    if request.param == "cuda":
        return request.getfixturevalue("cuda")
    return import_module(f"srt3d_ros.kernels.{request.param}")


def arguments(function) -> list[tuple]:
    """Names, kinds and default values of a function's arguments."""
    parameters = inspect.signature(function).parameters.values()
    return [(each.name, each.kind, each.default) for each in parameters if each.name != "self"]


def test_a_backend_has_exactly_the_names_of_the_contract(backend):
    assert sorted(backend.__all__) == sorted({*KERNELS, *CLASSES, *CONSTANTS})
    assert len(KERNELS) == 34 and all(hasattr(backend, name) for name in backend.__all__)


@pytest.mark.parametrize("name", KERNELS)
def test_a_kernel_has_the_arguments_of_the_contract(backend, name):
    assert arguments(getattr(backend, name)) == arguments(KERNELS[name])
    assert KERNELS[name].__doc__


@pytest.mark.parametrize(("name", "method"),
                         [("Scratch", "array"), ("FrameStream", "__init__"), ("FrameStream", "submit")])
def test_a_class_has_the_arguments_of_the_contract(backend, name, method):
    assert arguments(getattr(getattr(backend, name), method)) == arguments(getattr(CLASSES[name], method))


def test_constants_have_the_types_of_the_contract(backend):
    assert {name: type(getattr(backend, name)) for name in CONSTANTS} == {"ON_HOST": bool, "WARM_FRAMES": int}


@pytest.mark.parametrize("module", ["api", "constants", "maps", "reference"])
def test_what_all_backends_share_needs_numpy_alone(module):
    names = "{'numba', 'torch', 'triton', 'srt3d_ros.core', 'srt3d_ros.errors'}"
    program = f"import sys; import srt3d_ros.kernels.{module}; sys.exit(str({names} & set(sys.modules) or ''))"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.stderr.strip() == ""
