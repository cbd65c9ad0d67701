"""Work per pixel: kernels in torch (the contract, and what runs on a GPU) and in numba (for the CPU)."""

import os

# OpenMP's threads spin for milliseconds, by default, while they wait for their next kernel, on cores that other nodes
# need. Sleeping at once is not right either: to be woken for each of a frame's 70 kernels takes half as long as the
# work itself. So they spin for about as long as it takes to wake them, then sleep: 1000 turns of GNU's OpenMP, which
# numba uses on Linux. A frame of 141 × 141 pixels on two cores then takes 15 ms on an idle machine, and 33 beside a
# process that takes a core; 22 and 27 ms if they slept at once; 15 and 60 with ten times the turns. Read when OpenMP is
# loaded.
if "OMP_WAIT_POLICY" not in os.environ:
    os.environ["OMP_WAIT_POLICY"] = "passive"
    os.environ.setdefault("GOMP_SPINCOUNT", "1000")
