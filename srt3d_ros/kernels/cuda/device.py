"""Where the CUDA kernels run, and how arrays get there and back.

With TRITON_INTERPRET=1 in the environment before triton is imported, Triton runs the kernels through NumPy on tensors
of the CPU: slow, but the same code, so that they can be tested without a GPU.
"""

import os

import numpy as np
import torch
import triton

from srt3d_ros.kernels import reference

# One rounding for a product and its sum, which is also twice as fast: from version 3.10 on Triton wants to be asked for
# it. An explicit choice in the environment wins.
os.environ.setdefault("TRITON_DEFAULT_FP_FUSION", "1")

DEVICE = "cpu" if triton.knobs.runtime.interpret else "cuda"


def array(values):
    return torch.from_numpy(np.array(values, order="C")).to(DEVICE)


def numpy(values):
    return values.cpu().numpy()


class Scratch(reference.Scratch):
    dtype, device = torch.float32, DEVICE


def run_frame(function, *frame):
    *arrays, points, number = function(*map(array, frame))
    return *map(numpy, arrays), *reference.unpack((points.cpu(), number.cpu()))
