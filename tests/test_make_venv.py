"""scripts/make_venv.py: what it says, what it falls back to, and when it does nothing."""

import importlib.metadata
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from packaging.requirements import Requirement

from srt3d_ros.versions import versions


@pytest.fixture
def pip(tmp_path):
    """A stand-in for pip that writes down its arguments and knows no index but the usual one."""
    script, log = tmp_path / "pip", tmp_path / "log"
    script.write_text(f'#!/bin/sh\necho "$@" >> "{log}"\n'
                      'case "$*" in *--index-url*) echo "no route to it" >&2; exit 1;; esac\n')
    script.chmod(0o755)
    return SimpleNamespace(command=[str(script)], calls=lambda: log.read_text().splitlines())


def test_without_the_cpu_index_torch_is_asked_for_by_exact_version(make_venv, pip, capsys):
    make_venv.install_cpu_torch(pip.command)
    first, second = pip.calls()
    assert "--index-url https://download.pytorch.org/whl/cpu" in first
    assert second == make_venv.TORCH and "==" in second
    assert "cannot be reached" in capsys.readouterr().out


def test_a_step_shows_what_it_is_for_and_if_it_fails_what_its_command_printed(make_venv, capfd):
    make_venv.step("telling it", [sys.executable, "-c", "print('a long story')"])
    assert capfd.readouterr() == ("[venv] telling it\n", "")
    with pytest.raises(make_venv.StepFailed, match="(?s)a long story.*Failed: telling it"):
        make_venv.step("telling it", [sys.executable, "-c", "import sys; sys.exit('a long story')"])


def test_a_build_leaves_the_source_tree_as_it_was(make_venv, monkeypatch, tmp_path):
    """It may be read-only."""
    tree, environment = tmp_path / "tree", tmp_path / "straße 100 %"
    tree.mkdir(), environment.mkdir()
    (tree / "setup.py").write_text("from setuptools import setup\nsetup(name='tiny', py_modules=['tiny'])\n")
    (tree / "tiny.py").touch()
    monkeypatch.setenv("DIST_EXTRA_CONFIG", "")
    make_venv.build_in(environment / "build")
    monkeypatch.setattr(make_venv, "ROOT", tree)
    make_venv.step("building", [sys.executable, "-B", "setup.py", "egg_info", "build"])
    assert sorted(path.name for path in tree.iterdir()) == ["setup.py", "tiny.py"]


def test_nothing_is_done_while_the_environment_is_current(make_venv, monkeypatch, tmp_path, capfd):
    monkeypatch.setattr(make_venv, "install", lambda python, ros: pytest.fail("installed again"))
    for given, ros in (([], "jazzy"), (["kilted"], "kilted")):
        monkeypatch.setattr(sys, "argv", ["make_venv.py", str(tmp_path), *given])
        (tmp_path / "srt3d-stamp").write_text(make_venv.fingerprint(tmp_path, ros))
        assert make_venv.main() == 0
    assert capfd.readouterr() == ("", "")


def test_an_environment_of_another_place_or_another_python_is_made_anew(make_venv, tmp_path):
    python = tmp_path / "bin" / "python"
    assert not make_venv.usable(tmp_path, "jazzy", python)
    python.parent.mkdir()
    for prefix, version, usable in ((tmp_path, sys.version_info, True), ("/elsewhere", sys.version_info, False),
                                    (tmp_path, (3, 1), False)):
        python.write_text(f"#!/bin/sh\nprintf '%s\\n' '{prefix}' {version[0]} {version[1]}\n")
        python.chmod(0o755)
        assert make_venv.usable(tmp_path, "jazzy", python) is usable


def test_an_environment_of_another_distribution_is_made_anew(make_venv):
    """Here, the one that runs this test: each distribution's wheels have the other's names."""
    venv, ros = Path(sys.prefix), versions()["ros_distro"]
    if ros not in make_venv.ROS_EXTRAS:
        pytest.skip("ROS 2 is not from wheels")
    assert {name for name in make_venv.ROS_EXTRAS if make_venv.usable(venv, name, Path(sys.executable))} == {ros}


@pytest.mark.parametrize("given, folder, ros", [
    ([], ".venv", "jazzy"), (["ROS=kilted"], ".venv-kilted", "kilted"), (["ROS=kilted", "VENV=a b"], "a b", "kilted")])
def test_make_gives_each_distribution_a_folder_of_its_own(repository, monkeypatch, given, folder, ros):
    for name in ("MAKEFLAGS", "MAKEOVERRIDES"):         # of a make that runs this test
        monkeypatch.delenv(name, raising=False)
    said = subprocess.run(["make", "--dry-run", "demo", *given], cwd=repository, capture_output=True, text=True).stdout
    assert f"make_venv.py '{folder}' '{ros}'\n'{folder}/bin/srt3d' demo" in said


def test_each_distribution_is_an_extra_of_its_own_wheels(make_venv):
    wanted = [Requirement(text) for text in importlib.metadata.requires("srt3d_ros") if text.startswith("ros-")]
    for ros, extra in make_venv.ROS_EXTRAS.items():
        names = {one.name for one in wanted if one.marker.evaluate({"extra": extra})}
        assert names == {f"ros-{ros}-{name}" for name in ("rclpy", "common-interfaces", "rmw-fastrtps-cpp")}


def test_an_unknown_distribution_and_an_old_python_are_told_so_in_one_line(make_venv, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(sys, "argv", ["make_venv.py", str(tmp_path / "venv"), "humble"])
    assert make_venv.main() == 1 and not (tmp_path / "venv").exists()
    assert capsys.readouterr().err == "ROS=humble: expected jazzy or kilted\n"
    monkeypatch.setattr(make_venv.sys, "version_info", (3, 10, 1))
    assert make_venv.main() == 1
    said = capsys.readouterr().err
    assert "needs Python 3.11 or newer and this is 3.10" in said and said.count("\n") == 1
