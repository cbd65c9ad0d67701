"""Nothing that comes from outside is unpickled, evaluated or handed to a shell: the code is read and held to it."""

import ast
from pathlib import Path

import pytest

# Modules that are not to be imported, and calls that are not to be made, each with why.
MODULES = {name: "unpickles: what it reads can run code" for name in
           ("pickle", "cPickle", "_pickle", "cloudpickle", "dill", "joblib", "marshal", "shelve")}
CALLS = {
    "eval": "evaluates text", "exec": "evaluates text", "compile": "evaluates text", "__import__": "imports by text",
    "torch.load": "unpickles", "torch.hub.load": "downloads code", "os.system": "is a shell", "os.popen": "is a shell",
    "subprocess.getoutput": "is a shell", "subprocess.getstatusoutput": "is a shell", "tempfile.mktemp": "names a file "
    "that another can make first", "yaml.load": "can make any object", "yaml.load_all": "can make any object",
    "yaml.unsafe_load": "can make any object", "yaml.full_load": "can make any object", "os.chmod": "opens a file to "
    "others", "os.umask": "opens files to others",
}
NUMPY_LOADERS = {"load", "read_array", "memmap_load"}      # they take allow_pickle
CODE = ("srt3d_ros", "launch", "examples", "scripts", "robustness", "tools", "benchmarks", "setup.py")


def dangers(source: str) -> list[str]:
    """Lines of a module that do what none may, as 'line N: what, why'."""
    nodes, found, names = list(ast.walk(ast.parse(source))), [], {}
    for node in nodes:
        if isinstance(node, ast.Import | ast.ImportFrom):
            of = f"{node.module}." if isinstance(node, ast.ImportFrom) else ""
            names |= {alias.asname: of + alias.name for alias in node.names if alias.asname or of}
            names |= {alias.name: of + alias.name for alias in node.names if of}
            found += [(node, of + alias.name, MODULES[(of + alias.name).split(".")[0]]) for alias in node.names
                      if (of + alias.name).split(".")[0] in MODULES]
    for node in nodes:
        if isinstance(node, ast.Call):
            name, arguments = _full_name(node.func, names), {word.arg: word.value for word in node.keywords}
            if name in CALLS:
                found.append((node, name, CALLS[name]))
            if _is_true(arguments.get("shell")):
                found.append((node, f"{name}(shell=…)", "is a shell"))
            if name.startswith("numpy.") and name.split(".")[-1] in NUMPY_LOADERS and not _is_false(
                    arguments.get("allow_pickle")):
                found.append((node, name, "without allow_pickle=False"))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith("/tmp/"):
            found.append((node, node.value, "a name in /tmp that another can make first"))
    return [f"line {node.lineno}: {what}, {why}" for node, what, why in found]


def _full_name(function: ast.expr, names: dict[str, str]) -> str:
    """`np.load` as numpy.load; of a method of some object only what can be told."""
    parts = []
    while isinstance(function, ast.Attribute):
        parts.append(function.attr)
        function = function.value
    parts.append(names.get(function.id, function.id) if isinstance(function, ast.Name) else "…")
    return ".".join(reversed(parts))


def _is_false(value: ast.expr | None) -> bool:
    return isinstance(value, ast.Constant) and value.value is False


def _is_true(value: ast.expr | None) -> bool:
    return value is not None and not _is_false(value)


def modules(repository: Path) -> list[Path]:
    places = [repository / name for name in CODE if (repository / name).exists()]
    return [path for place in places for path in ([place] if place.is_file() else sorted(place.rglob("*.py")))]


def test_no_module_unpickles_evaluates_or_starts_a_shell(repository):
    read = modules(repository)
    assert len(read) > 100
    found = [f"{path.relative_to(repository)}, {danger}" for path in read for danger in dangers(path.read_text())]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("source", [
    "import pickle", "from joblib import load", "import numpy as np\nnp.load(path)",
    "from numpy import load\nload(path)", "import os.path, marshal",
    "import numpy as np\nnp.load(path, allow_pickle=True)", "import numpy as np\nnp.lib.format.read_array(f)",
    "import numpy as np\nnp.load(path, allow_pickle=trusted)", "import torch\ntorch.load(path)", "eval(text)",
    "import yaml\nyaml.load(text)", "from yaml import unsafe_load\nunsafe_load(text)", "import os\nos.system(text)",
    "import subprocess\nsubprocess.run(text, shell=True)", "import tempfile as t\nt.mktemp()", "open('/tmp/x', 'w')",
    "__import__(name)", "import os\nos.chmod(path, 0o777)",
])
def test_what_may_not_be_is_found(source):
    assert dangers(source)


@pytest.mark.parametrize("source", [
    "import numpy as np\nnp.load(path, allow_pickle=False)", "import re\nre.compile(text)", "model.eval()",
    "import yaml\nyaml.safe_load(text)", "import subprocess\nsubprocess.run(['ls', path])", "import json\njson.load(f)",
])
def test_what_may_be_is_not(source):
    assert not dangers(source)
