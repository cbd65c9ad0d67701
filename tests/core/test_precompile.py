"""precompile leaves nothing to compile for what runs by default."""

import subprocess
import sys

COUNT = """
from numba.core import event
from srt3d_ros.core import precompile

class Count(event.Listener):
    compiled = []
    def on_start(self, event): self.compiled.append(event.data["dispatcher"].__name__)
    def on_end(self, event): pass

event.register("numba:compile", Count())
{step}
print(*sorted(set(Count.compiled) & {kept!r}))
"""
KEPT = {"_update", "_search", "_pooled_step", "_collect", "_sketch_sorted", "_sketch_unsorted", "_sketch_gates"}


def compiled(step: str) -> set[str]:
    """Which of these kernels a process had to compile."""
    program = COUNT.format(step=step, kept=KEPT)
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return set(run.stdout.split())


def test_what_runs_later_has_been_compiled_ahead():
    """In the user's own cache, which has most of it."""
    compiled("precompile.sketching(); precompile.reconstruction()")
    other = "precompile.PooledStream(precompile.ANY_SENSOR, (1, 2, 3), 2, warm_start=True, device='cpu')"
    assert compiled(f"precompile.sketching(); {other}.warm_up()") == set()
