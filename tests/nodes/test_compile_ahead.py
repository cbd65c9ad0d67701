"""compile_ahead leaves nothing to compile for the nodes' start."""

import json
import subprocess
import sys

REPORT = """
import importlib, json, pkgutil
from numba.core.dispatcher import Dispatcher
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.kernels import cpu
from srt3d_ros.nodes import compile_ahead as ahead
{what}
modules = [importlib.import_module(found.name) for found in pkgutil.iter_modules(cpu.__path__, cpu.__name__ + ".")]
kernels = [value for module in modules for value in vars(module).values()
           if isinstance(value, Dispatcher) and hasattr(value._cache, "_cache_file")]       # what is kept
print(json.dumps(sorted({{f"{{kernel.py_func.__module__}}.{{kernel.__name__}}{{signature}}"
                         for kernel in kernels for signature in kernel.signatures}})))
"""
AHEAD = "ahead.compile_birth_death(); ahead.compile_others()"
AT_START = "ahead.warm_up(); Pooled(ahead.ANY_SENSOR, ahead.FREQUENCIES, device='cpu').warm_up()"


def compiled(what: str) -> set[str]:
    """The kernels, with the types of their arguments, of a process that does this."""
    run = subprocess.run([sys.executable, "-c", REPORT.format(what=what)], capture_output=True, text=True, check=True)
    return set(json.loads(run.stdout))


def test_what_the_nodes_run_at_their_start_has_been_compiled_ahead():
    compiled(AT_START)              # once compiled, what they call among themselves does not show
    at_start = compiled(AT_START)
    assert len(at_start) > 20 and any("birth_death" in kernel for kernel in at_start)
    assert at_start <= compiled(AHEAD)
