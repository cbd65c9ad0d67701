"""precompile leaves nothing to compile for what runs later."""

import json
import subprocess
import sys

import pytest

REPORT = """
import json
import numpy as np
from srt3d_ros.core import precompile as ahead
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.kernels.cpu import compiling
{what}
print(json.dumps(sorted({{f"{{compiling.name_of(kernel)}}{{signature}}"
                         for kernel in compiling.KERNELS for signature in kernel.signatures}})))
"""
AHEAD = "for part in ahead.PARTS:\n for step in part: {}step()"
# As the nodes do when they start, and with what a user may set.
NODES = """
ahead.sketching()
sensor = ahead.ANY_SENSOR
for options in ({}, {"surfaces": 2, "warm_start": True, "background": "auto", "upsampling": 2}):
    Pooled(sensor, ahead.FREQUENCIES, device="cpu", **options).warm_up()
"""
METHODS = "for method in METHODS.values(): method.build(ahead.ANY_SENSOR, ahead.FREQUENCIES, device='cpu').warm_up()"


def compiled(what: str) -> set[str]:
    """The kernels, with the types of their arguments, of a process that does this."""
    run = subprocess.run([sys.executable, "-c", REPORT.format(what=what)], capture_output=True, text=True, check=True)
    return set(json.loads(run.stdout))


@pytest.mark.parametrize("later, ahead", [(NODES, AHEAD.format("step in ahead.BASELINES or ")),
                                          (METHODS, AHEAD.format(""))])
def test_what_runs_later_has_been_compiled_ahead(later, ahead):
    compiled(later)             # once compiled, what kernels call among themselves does not show
    wanted = compiled(later)
    assert len(wanted) > 15 and any("birth_death" in kernel for kernel in wanted)
    assert wanted <= compiled(ahead)
