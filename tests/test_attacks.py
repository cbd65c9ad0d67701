"""The attacks of scripts/attacks, for some rounds: that they do their harm, and that it is survived."""

import json
import subprocess
import sys

ATTACKS = "scripts/attacks"
SEED = 53           # doubles packets, kills the sketcher, sets parameters of the reconstructor
PATIENCE = "60"     # seconds, for clouds: the machine may be busy


def attack(repository, out, *options) -> tuple[int, str, list[dict]]:
    """Exit code, what was said, and the rounds."""
    command = [sys.executable, f"{ATTACKS}/faults.py", "--out", str(out), *options]
    ended = subprocess.run(command, cwd=repository, capture_output=True, text=True)
    return ended.returncode, ended.stdout + ended.stderr, json.loads(out.read_text())["rounds"]


def test_faults_are_done_and_survived(repository, tmp_path):
    code, said, rounds = attack(repository, tmp_path / "faults.json", "--rounds", "3", "--seed", str(SEED), "--only",
                                "kill", "doubled", "parameters", "--back-s", PATIENCE, "--picture",
                                str(tmp_path / "faults.svg"))
    assert code == 0, said
    played = {one["fault"]: one for one in rounds}
    assert played.keys() == {"kill", "doubled", "parameters"} and not any(one["problems"] for one in rounds)
    assert played["kill"]["evidence"]["node"] == "sketcher"
    assert 0 < played["doubled"]["lost"]["sketcher: duplicate"] <= played["doubled"]["evidence"]["packets"]
    assert played["parameters"]["evidence"]["node"] == "reconstructor"
    assert played["parameters"]["evidence"]["changed"] and played["parameters"]["evidence"]["refused"] >= 3
    assert "3 of 3 rounds passed" in said and (tmp_path / "faults.svg").stat().st_size > 1000


def test_a_round_that_fails_says_how_to_repeat_it_and_keeps_its_logs(repository, tmp_path):
    """No cloud can be back within no time."""
    code, said, rounds = attack(repository, tmp_path / "faults.json", "--rounds", "1", "--first", "7", "--only", "lost",
                                "--back-s", "0")
    assert code == 1 and rounds[0]["evidence"]["packets"] > 0 and "clouds were back after" in rounds[0]["problems"][0]
    assert "to repeat: faults.py --seed 1 --first 7 --rounds 1 --only lost" in said and "0 of 1 rounds passed" in said
    logs = {path.name.partition("_")[2] for path in (tmp_path / "faults" / "round_007").iterdir()}
    assert logs == {"driver.log", "sketcher.log", "reconstructor.log", "recorder.log", "bag_recorder.log"}
