"""Which advisories an installed version falls under, by the rules of OSV, of which advisories.py reads files."""

import json
import subprocess
import sys

import pytest


@pytest.fixture(scope="module")
def advisories(attack):
    return attack("advisories")


def advisory(*events, versions=(), name="Some_Package", ecosystem="PyPI"):
    return {"id": "A-1", "affected": [{"package": {"name": name, "ecosystem": ecosystem}, "versions": list(versions),
                                       "ranges": [{"type": "ECOSYSTEM", "events": list(events)}]}]}


@pytest.mark.parametrize("told, hit", [
    (advisory({"introduced": "0"}), True),
    (advisory({"introduced": "0"}, {"fixed": "2.10"}), True),           # 2.9 is older than 2.10
    (advisory({"introduced": "0"}, {"fixed": "2.9"}), False),
    (advisory({"introduced": "2.10"}), False),
    (advisory({"introduced": "0"}, {"last_affected": "2.9"}), True),
    (advisory({"introduced": "0"}, {"fixed": "1"}, {"introduced": "2"}, {"fixed": "3"}), True),
    (advisory(versions=["2.9"]), True),
    (advisory(versions=["2.9"], name="other"), False),
    (advisory(versions=["2.9"], ecosystem="npm"), False),
])
def test_a_version_falls_under_an_advisory_as_osv_says(advisories, told, hit):
    assert advisories.affected(told, {"some-package": "2.9"}) == ({"some-package"} if hit else set())


def test_an_advisory_in_a_database_is_found_and_named(repository, tmp_path):
    for name, more in (("a.json", {}), ("withdrawn.json", {"id": "A-2", "withdrawn": "2026-01-01T00:00:00Z"})):
        told = advisory({"introduced": "0"}, name="pytest") | {"summary": "bad"} | more
        (tmp_path / name).write_text(json.dumps(told))
    script = repository / "scripts" / "attacks" / "advisories.py"
    command = [sys.executable, script, "--offline", "--database", tmp_path, "--json", tmp_path / "out" / "result.json"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1 and "A-1: bad" in done.stdout and "A-2" not in done.stdout
    assert [one["id"] for one in json.loads((tmp_path / "out" / "result.json").read_text())["advisories"]] == ["A-1"]
