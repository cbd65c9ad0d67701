"""Which device computes, and what is said where the one that is asked for is missing."""

import logging
import os
import re
import subprocess
import sys

import numpy as np
import pytest
import torch

from srt3d_ros.core import device
from srt3d_ros.core.device import kernels_for
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import InvalidInput

SENSOR = SensorModel(4, 5, 64, 1e-10, np.ones(3))


@pytest.fixture
def missing(monkeypatch):
    """Makes a machine lack something, whatever this one has."""
    def set_to(driver: str = "libc.so.6", absent=(), cuda: str | None = "13.0", gpu: bool = True):
        monkeypatch.delenv("TRITON_INTERPRET", raising=False)
        monkeypatch.setattr(device, "DRIVER", driver)
        monkeypatch.setattr(device, "find_spec", lambda name: None if name in absent else object())
        monkeypatch.setattr(torch.version, "cuda", cuda)
        monkeypatch.setattr(torch.cuda, "is_available", lambda: gpu)
        device._say.cache_clear()
    return set_to


LACKS = [({"driver": "libnone.so"}, "no CUDA device"), ({"gpu": False}, "no CUDA device"),
         ({"absent": ["triton"]}, "triton not installed: pip install 'srt3d_ros[gpu]'"),
         ({"absent": ["torch", "triton"]}, "torch and triton not installed: pip install 'srt3d_ros[gpu]'"),
         ({"cuda": None}, f"torch {torch.__version__} is built without")]


@pytest.mark.parametrize(("lack", "said"), LACKS)
def test_what_cuda_lacks_is_said_in_one_line_and_auto_computes_on_the_cpu(missing, caplog, lack, said):
    missing(**lack)
    with caplog.at_level(logging.INFO):
        assert [kernels_for("auto")[0] for _ in range(2)] == ["cpu", "cpu"]
    assert len(caplog.messages) == 1 and re.fullmatch(f"{re.escape(said)}.*: computing on the CPU", caplog.messages[0])
    for make in (kernels_for, lambda name: Pooled(SENSOR, (1, 2), device=name)):
        with pytest.raises(InvalidInput, match=f"^device is cuda: expected cpu or auto: {re.escape(said)}[^\n]*$"):
            make("cuda")


def test_where_there_is_no_gpu_either_what_to_install_is_said_all_the_same(missing):
    missing(driver="libnone.so", absent=["torch"])
    with pytest.raises(InvalidInput, match=r"no CUDA device, and torch not installed: pip install 'srt3d_ros\[gpu\]'$"):
        kernels_for("cuda")


def test_auto_takes_the_gpu_and_the_cpu_can_be_asked_for(missing, caplog):
    pytest.importorskip("srt3d_ros.kernels.cuda", reason="triton")      # now, while its environment is as it was
    missing()
    with caplog.at_level(logging.INFO):
        assert [kernels_for(name)[0] for name in ("auto", "cuda", "cpu")] == ["cuda", "cuda", "cpu"]
    assert not caplog.messages
    names = [kernels_for(name)[1].__name__ for name in ("auto", "cpu")]
    assert names == ["srt3d_ros.kernels.cuda", "srt3d_ros.kernels.cpu"]


WITHOUT_THE_REST = """
import sys
for name in ("numba", "rclpy", "rerun", "scipy", "matplotlib", "tqdm", "PIL"):
    sys.modules[name] = None
import numpy as np
from srt3d_ros.core import pooled
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
pooled.WINDOWS, pooled.SLANTS, pooled.FIRST_STEPS = ((2.0, 1),), (), 1           # interpretation is slow
sensor = SensorModel(1, 2, 32, 1e-10, np.ones(3))
sums = np.full((1, 2, 3), 50 * np.exp(2j * np.pi * np.array([1, 2, 3]) * 20 / 32), np.complex64)
reconstructor = pooled.Pooled(sensor, (1, 2, 3), device="cuda")
cloud = reconstructor(Sketch((1, 2, 3), sums, np.full((1, 2), 50, np.uint32)))
assert reconstructor.device == "cuda" and len(cloud) == 2, cloud
assert np.allclose(cloud.depth_bins, 20, atol=1), cloud.depth_bins
"""


def test_torch_and_triton_are_enough_on_a_gpu():
    pytest.importorskip("triton")
    environment = dict(os.environ) | ({} if torch.cuda.is_available() else {"TRITON_INTERPRET": "1"})
    run = subprocess.run([sys.executable, "-c", WITHOUT_THE_REST], env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
