"""precompile leaves nothing to compile for what runs later."""

import json
import subprocess
import sys

REPORT = """
import json
from srt3d_ros.core import precompile as ahead
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.kernels.cpu import compiling

def report():
    print(json.dumps([f"{compiling.name_of(kernel)}{signature}"
                      for kernel in compiling.KERNELS for signature in kernel.signatures]))
"""
AHEAD = """
steps = [step for part in ahead.PARTS for step in part]
for step in steps:
    if step not in ahead.BASELINES:
        step()
report()
for step in ahead.BASELINES:
    step()
report()
"""
# As the nodes do when they start, and with what a user may set.
NODES = """
ahead.sketching()
for options in ({}, {"surfaces": 2, "warm_start": True, "background": "auto", "upsampling": 2}):
    Pooled(ahead.ANY_SENSOR, ahead.FREQUENCIES, device="cpu", **options).warm_up()
report()
"""
OTHERS = """
for method in METHODS.values():
    method.build(ahead.ANY_SENSOR, ahead.FREQUENCIES, device="cpu").warm_up()
report()
"""


def compiled(what: str) -> list[set[str]]:
    """The kernels, with the types of their arguments, that a process has at each report; from the cache if they can."""
    run = subprocess.run([sys.executable, "-c", REPORT + what], capture_output=True, text=True, check=True)
    return [set(json.loads(line)) for line in run.stdout.splitlines()]


def test_what_runs_later_has_been_compiled_ahead():
    without_baselines, everything = compiled(AHEAD)
    nodes, = compiled(NODES)
    others, = compiled(OTHERS)
    assert len(nodes) > 15 and any("birth_death" in kernel for kernel in nodes)
    assert nodes <= without_baselines and others <= everything
