"""Lowers functions for a GPU on a machine without one: what Inductor would launch there, and how many bytes it moves.

It needs torch's CUDA build and triton, and no GPU: tensors are fake, and no kernel is compiled. It reaches into
Inductor, so that it goes with the version that `make gpu-cost` installs.
"""

import types
from collections.abc import Callable
from typing import NamedTuple

import torch
import torch._dynamo.device_interface as device_interface
import torch._inductor.config as config
import torch.utils._triton as has
import triton
from torch._inductor.debug import DebugContext
from torch._inductor.decomposition import select_decomp_table
from torch._inductor.graph import GraphLowering
from torch._inductor.virtualized import V
from torch.fx.experimental.proxy_tensor import make_fx
from torch.utils.flop_counter import FlopCounterMode
from triton.backends.compiler import GPUTarget

from srt3d_ros.kernels.torch.fusing import OPTIONS

H100 = types.SimpleNamespace(
    name="NVIDIA H100 80GB HBM3", major=9, minor=0, multi_processor_count=132, total_memory=80 * 2**30, warp_size=32,
    max_threads_per_multi_processor=2048, regs_per_multiprocessor=65536, gcnArchName="", L2_cache_size=50 * 2**20,
    shared_memory_per_block=49152, shared_memory_per_block_optin=232448, shared_memory_per_multiprocessor=233472,
    max_threads_per_block=1024, clock_rate=1980000, memory_clock_rate=2619000, memory_bus_width=5120, uuid="",
    pci_bus_id=0, is_integrated=0)


class Cost(NamedTuple):
    """Of one call: kernels launched, products of matrices among them; bytes; operations of the products."""

    launches: int
    products: int
    bytes: int
    flops: int


class _Driver:
    """Triton's, as far as it is asked for the kind of GPU."""

    get_current_target = staticmethod(lambda: GPUTarget("cuda", 90, 32))
    get_current_device = staticmethod(lambda: 0)
    get_active_torch_device = staticmethod(lambda: torch.device("cuda", 0))
    get_device_interface = staticmethod(lambda: torch.cuda)
    is_active = staticmethod(lambda: True)


def pretend() -> None:
    """Let torch and triton take this machine for one with an H100, for as long as nothing runs on it."""
    torch._C._ensureCUDADeviceGuardSet()
    answers = {"get_device_properties": H100, "get_device_capability": (9, 0), "current_device": 0, "device_count": 1,
               "synchronize": None}
    for name, answer in answers.items():
        setattr(torch.cuda, name, lambda *_, answer=answer: answer)
    torch._C._cuda_getDeviceCount = lambda: 1
    interface = device_interface.CudaInterface
    for name, answer in {**answers, "is_available": True, "get_compute_capability": 90, "is_triton_capable": True,
                         "raise_if_triton_unavailable": None}.items():
        setattr(interface, name, staticmethod(lambda *_, answer=answer: answer))
    interface.Worker.get_device_properties = staticmethod(lambda *_: H100)
    has.has_triton = lambda *_: True
    triton.runtime.driver.set_active(_Driver())


def cost(function: Callable, tensors: list) -> Cost:
    """Of a function of fake tensors. Bytes are those that its kernels must read and write: each of a kernel's buffers
    once (`GraphLowering.count_bytes`), so that what a cache would have to hold counts as held.
    """
    mode = tensors[0].fake_mode
    with mode, FlopCounterMode(display=False) as flops:
        graph = make_fx(torch.func.functionalize(function, remove="mutations"),
                        decomposition_table=select_decomp_table(), tracing_mode="real")(*tensors)
    graph.graph.eliminate_dead_code()
    with config.patch(**OPTIONS, pattern_matcher=False), V.set_fake_mode(mode):
        lowered = GraphLowering(graph, example_inputs=tensors, shape_env=mode.shape_env, is_inference=True)
        with V.set_graph_handler(lowered), V.set_debug_handler(DebugContext()):
            lowered.run(*tensors)
            code = lowered.codegen()[0]
            moved, *_ = lowered.count_bytes()
    body = getattr(code, "value", code).partition("def call")[2].splitlines()
    products = sum("extern_kernels." in line for line in body)
    others = sum(".run(" in line or "= torch.ops." in line for line in body if not line.lstrip().startswith("#"))
    return Cost(products + others, products, int(moved), flops.get_total_flops())
