"""No code unpickles input in a way that the rules S of `make lint` miss."""

import re

CODE = ("srt3d_ros", "launch", "examples", "scripts", "tools", "benchmarks")
UNPICKLES = r"allow_pickle=(?!False\b)|torch\.(load|hub)\b|(cloudpickle|dill|joblib|yaml\.(unsafe|full))[._]load"


def test_no_module_unpickles(repository):
    paths = [path for name in CODE for path in (repository / name).rglob("*.py")]
    assert len(paths) > 100
    assert not [path for path in paths if re.search(UNPICKLES, path.read_text())]
