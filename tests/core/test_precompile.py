"""precompile leaves nothing to compile for what runs by default."""

import subprocess
import sys

COMPILED_LATER = """
from numba.core import event
from srt3d_ros.core import precompile

class Count(event.Listener):
    compiled = []
    def on_start(self, event): self.compiled.append(event.data["dispatcher"].__name__)
    def on_end(self, event): pass

precompile.sketching()
precompile.reconstruction()
event.register("numba:compile", Count())
precompile.PooledStream(precompile.ANY_SENSOR, (1, 2, 3), 2, warm_start=True, device="cpu").warm_up()
print(*Count.compiled)
"""


def test_what_runs_later_has_been_compiled_ahead():
    run = subprocess.run([sys.executable, "-c", COMPILED_LATER], capture_output=True, text=True, check=True)
    assert run.stdout.split() == []
