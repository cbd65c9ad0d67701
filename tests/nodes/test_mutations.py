"""Mutated messages: the attack of scripts/attacks/mutate.py on the real nodes, for some seconds."""

import json
import subprocess
import sys

MESSAGES = 1020


def test_mutated_messages_end_nothing_and_no_good_frame_among_them_is_lost(repository, tmp_path):
    out = tmp_path / "mutate.json"
    attack = subprocess.run([sys.executable, repository / "scripts/attacks/mutate.py", "--messages", str(MESSAGES),
                             "--seed", "3", "--hang-s", "60", "--out", out], capture_output=True, text=True)
    assert attack.returncode == 0, attack.stdout + attack.stderr
    facts = json.loads(out.read_text())
    assert (facts["mutated_messages"], facts["lost"], facts["not_bit_equal"], facts["problems"]) == (MESSAGES, 0, 0, [])
    assert facts["good_frames"] >= 20
    accounting = facts["accounting"]
    assert int(accounting["sketcher"]["dropped.malformed"]) > 100
    assert int(accounting["reconstructor"]["dropped.malformed"]) > 50
    assert all(report["unaccounted_frames"] == report["under_way"] == "0" for report in accounting.values())

