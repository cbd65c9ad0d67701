"""Compile what the nodes run on a CPU before they do: half of it in each of two processes, else the first start waits.

    python -m srt3d_ros.nodes.compile_ahead

`birth_death` takes as long as most other kernels together. What is compiled is kept (`kernels.cpu.compiling`).
"""

import subprocess
import sys
from types import SimpleNamespace

import numpy as np

from srt3d_ros.core.frame import Matcher
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.pooled import Pooled, noise_sketch
from srt3d_ros.kernels import cpu, layout
from srt3d_ros.kernels.constants import SAME_SURFACE
from srt3d_ros.nodes.sketching import ANY_SENSOR, warm_up

FREQUENCIES = choose("auto", ANY_SENSOR, 3)


def compile_birth_death() -> None:
    """Compile `birth_death`, by a step from no surfaces."""
    frame = Matcher(ANY_SENSOR, FREQUENCIES)(noise_sketch(ANY_SENSOR, FREQUENCIES)).padded
    state = np.zeros(layout.state_shape(*frame.shape, 1), np.float32)
    cpu.birth_death(frame, state, cpu.expand(frame, state), SAME_SURFACE**2)


def compile_others() -> None:
    """Compile all but `birth_death`, by a reconstruction in which no surface moves, and what the sketcher runs."""
    warm_up()
    reconstructor = Pooled(ANY_SENSOR, FREQUENCIES, device="cpu")
    reconstructor.kernels = SimpleNamespace(**vars(cpu) | {"birth_death": lambda frame, state, *_: state.copy()})
    reconstructor(noise_sketch(ANY_SENSOR, FREQUENCIES))


def main() -> int:
    if "birth_death" in sys.argv[1:]:
        compile_birth_death()
        return 0
    other = subprocess.Popen([sys.executable, "-m", "srt3d_ros.nodes.compile_ahead", "birth_death"])
    try:
        compile_others()
    finally:
        code = other.wait()
    return code


if __name__ == "__main__":
    sys.exit(main())
