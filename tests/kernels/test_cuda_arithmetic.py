"""Arithmetic of the CUDA kernels against float64."""

import numpy as np
import pytest

triton = pytest.importorskip("triton")
import triton.language as tl  # noqa: E402

from srt3d_ros.kernels.cuda.arithmetic import sincos, wrap  # noqa: E402


@triton.jit
def _all(values, sine, cosine, wrapped, period, N: tl.constexpr):
    at = tl.arange(0, N)
    value = tl.load(values + at)
    s, c = sincos(value)
    tl.store(sine + at, s)
    tl.store(cosine + at, c)
    tl.store(wrapped + at, wrap(value, period))


def test_sine_cosine_and_differences_on_a_circle(cuda):
    values = np.random.default_rng(0).normal(0, 20, 1024).astype(np.float32)
    results = [cuda.array(np.zeros_like(values)) for _ in range(3)]
    _all[(1,)](cuda.array(values), *results, 3.0, 1024)
    sine, cosine, wrapped = (cuda.numpy(r) for r in results)
    exact = values.astype(np.float64)
    np.testing.assert_allclose(sine, np.sin(2 * np.pi * exact), rtol=0, atol=1e-6)
    np.testing.assert_allclose(cosine, np.cos(2 * np.pi * exact), rtol=0, atol=1e-6)
    np.testing.assert_allclose(wrapped, exact - 3 * np.rint(exact / 3), rtol=0, atol=1e-5)
    assert sine.dtype == np.float32
