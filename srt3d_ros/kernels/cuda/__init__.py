"""The CUDA kernels: those of `reference` in single precision on a GPU, and in Triton where these take too long.

They read and write device memory only and never wait for it.
"""

from srt3d_ros.kernels.cuda.birth_death import birth_death
from srt3d_ros.kernels.cuda.device import Scratch, array, numpy, run_frame
from srt3d_ros.kernels.cuda.pooled_step import pooled_step
from srt3d_ros.kernels.reference import (
    ON_HOST,
    apss,
    blur,
    collect,
    drop_weak,
    expand,
    finalise,
    log_likelihood_ratio,
    match,
    pixelwise,
    poisson,
    prepare,
    residual,
    search,
    trim,
    unexplained,
    unpack,
)
