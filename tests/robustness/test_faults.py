"""`python -m robustness faults`, for some rounds: faults are done and survived, and a failure is reported."""

import argparse
import json
import subprocess
import sys

from robustness.__main__ import finish

BACK_S = "60"       # for clouds to be back: the machine may be busy


def test_faults_are_done_and_survived(repository, tmp_path):
    out = tmp_path / "faults.json"
    ended = subprocess.run(
        [sys.executable, "-m", "robustness", "faults", "--rounds", "3", "--only", "kill", "cut", "odom_jump",
         "--back-s", BACK_S, "--out", out], cwd=repository, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    seen = json.loads(out.read_text())["faults"]
    assert {name: (one["rounds"], one["failed"]) for name, one in seen.items()} == dict.fromkeys(
        ("kill", "cut", "odom_jump"), (1, 0))
    assert seen["cut"]["lost"]["sketcher: malformed"] > 0
    assert "SIGKILL" in ended.stderr and "faults: holds" in ended.stdout


def test_one_check_that_fails_fails_the_command_and_is_in_its_summary(tmp_path, capsys):
    args = argparse.Namespace(command="faults", out=tmp_path / "faults.json")
    assert finish(args, [("kill", True, "1 round"), ("stop", False, "a cloud at 2.00 m")], {"rounds": 2}) == 1
    assert "holds  kill: 1 round\nFAILS  stop: a cloud at 2.00 m\nfaults: FAILS" in capsys.readouterr().out
    summary = json.loads(args.out.read_text())
    assert (summary["failed"], summary["rounds"]) == (["stop: a cloud at 2.00 m"], 2)
    assert finish(args, [("kill", True, "1 round")], {}) == 0
