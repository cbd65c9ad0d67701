"""Compiles functions for a GPU on a machine without one, to count kernel launches and bytes.

Needs torch's CUDA build and triton. Tensors are fake, and compiling stops once torch has generated the source of the
kernels. This patches private parts of torch: it works with the version that `make gpu-cost` installs.
"""

import types
from collections.abc import Callable
from typing import NamedTuple

import torch
import torch._dynamo.device_interface as device_interface
import torch._inductor.fx_passes.joint_graph as joint_graph
import torch._subclasses.fake_tensor as fake_tensor
import torch.utils._triton as has
import triton
from torch._inductor.graph import GraphLowering
from torch.utils._python_dispatch import _disable_current_modes
from torch.utils.flop_counter import FlopCounterMode
from triton.backends.compiler import GPUTarget

from srt3d_ros.kernels.torch.fusing import Fused

H100 = types.SimpleNamespace(
    name="NVIDIA H100 80GB HBM3", major=9, minor=0, multi_processor_count=132, total_memory=80 * 2**30, warp_size=32,
    max_threads_per_multi_processor=2048, regs_per_multiprocessor=65536, gcnArchName="", L2_cache_size=50 * 2**20,
    shared_memory_per_block=49152, shared_memory_per_block_optin=232448, shared_memory_per_multiprocessor=233472,
    max_threads_per_block=1024, clock_rate=1980000, memory_clock_rate=2619000, memory_bus_width=5120, uuid="",
    pci_bus_id=0, is_integrated=0)
GENERATED: list[tuple[str, float]] = []     # source of a function, and the bytes that it moves


class Cost(NamedTuple):
    """Cost of one call: kernel launches, matrix products among them, bytes, and operations of the products."""

    launches: int
    products: int
    bytes: int
    flops: int


class Generated(Exception):
    """Raised once the source of the kernels is known, so that torch does not compile it."""


class _Driver:
    """A driver of triton that only says which GPU there is."""

    get_current_target = staticmethod(lambda: GPUTarget("cuda", 90, 32))
    get_current_device = staticmethod(lambda: 0)
    get_active_torch_device = staticmethod(lambda: torch.device("cuda", 0))
    get_device_interface = staticmethod(lambda: torch.cuda)
    is_active = staticmethod(lambda: True)


def pretend() -> None:
    """Make torch and triton believe that there is an H100. Nothing can run on it."""
    torch._C._ensureCUDADeviceGuardSet()
    answers = {"get_device_properties": H100, "get_device_capability": (9, 0), "current_device": 0, "device_count": 1,
               "synchronize": None}
    state = {"is_initialized": True, "set_rng_state": None, "_exchange_device": 0, "_maybe_exchange_device": 0,
             "is_current_stream_capturing": False, "get_rng_state": torch.zeros(16, dtype=torch.uint8)}
    for name, answer in (answers | state).items():
        setattr(torch.cuda, name, lambda *_, answer=answer: answer)
    torch._C._cuda_getDeviceCount = lambda: 1
    interface = device_interface.CudaInterface
    for name, answer in {**answers, "is_available": True, "get_compute_capability": 90, "is_triton_capable": True,
                         "raise_if_triton_unavailable": None}.items():
        setattr(interface, name, staticmethod(lambda *_, answer=answer: answer))
    interface.Worker.get_device_properties = staticmethod(lambda *_: H100)
    has.has_triton = lambda *_: True
    triton.runtime.driver.set_active(_Driver())
    for module, name in ((fake_tensor, "init_gpu_context"), (joint_graph, "lazy_init")):     # both run kernels
        setattr(module, name, lambda *_: None)
    generate = GraphLowering.codegen

    def codegen(graph):
        code, *_ = generate(graph)
        GENERATED.append((getattr(code, "value", code), graph.count_bytes()[0]))
        raise Generated

    GraphLowering.codegen = codegen


def cost(function: Callable, tensors: list) -> Cost:
    """The cost of a function of fake tensors.

    Bytes are those that kernels must read and write: each buffer of a kernel counts once (`GraphLowering.count_bytes`).
    """
    with tensors[0].fake_mode, FlopCounterMode(display=False) as flops:
        function(*tensors)
    torch._dynamo.reset()
    with _disable_current_modes():      # within a mode, torch.compile runs functions uncompiled
        try:
            Fused(function).compile(joint_graph_constant_folding=False)(*tensors)
        except Exception:
            if not GENERATED:
                raise
    code, moved = GENERATED.pop()
    body = code.partition("def call")[2].splitlines()
    products = sum("extern_kernels." in line for line in body)
    others = sum(".run(" in line or "= torch.ops." in line for line in body if not line.lstrip().startswith("#"))
    return Cost(products + others, products, int(moved), flops.get_total_flops())
