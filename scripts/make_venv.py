"""Make or refresh the virtual environment that `make demo` and `make test` use. Standard library only.

Usage: python3 scripts/make_venv.py [FOLDER [ROS]]     .venv with jazzy unless given, or kilted

Nothing is done while the environment is current.
"""

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ROS_EXTRAS = {"jazzy": "ros", "kilted": "ros-kilted"}
EXTRAS = "record,review,test"
# The version that the project is tested with, by exact number: the newest may exist as gigabytes of CUDA only.
TORCH = "torch==2.13.0"
CPU_INDEX = "https://download.pytorch.org/whl/cpu"
# What torch (lower bound) and colcon (upper bound) both accept; pyproject.toml says the same.
SETUPTOOLS = "setuptools>=77.0.3,<80"
# Python brings its own; older ones have a known advisory (PYSEC-2023-228).
PIP = "pip>=23.3,<27"


class StepFailed(Exception):
    """The command of a step failed; the text is what it printed."""


def main():
    if sys.version_info < (3, 11):
        print("srt3d_ros needs Python 3.11 or newer and this is %d.%d: try make PYTHON=python3.12 ..."
              % sys.version_info[:2], file=sys.stderr)
        return 1
    folder, ros = [*sys.argv[1:], *(ROOT / ".venv", "jazzy")[len(sys.argv) - 1:]]
    if ros not in ROS_EXTRAS:
        print(f"ROS={ros}: expected {' or '.join(ROS_EXTRAS)}", file=sys.stderr)
        return 1
    venv = Path(os.path.abspath(folder))
    stamp, wanted = venv / "srt3d-stamp", fingerprint(venv, ros)
    if stamp.is_file() and stamp.read_text() == wanted:
        return 0
    python = venv / "bin" / "python"
    started = time.monotonic()
    try:
        if not usable(venv, ros, python):
            step(f"making {venv.name} for Python {sys.version_info[0]}.{sys.version_info[1]}",
                 [sys.executable, "-m", "venv", "--clear", venv])
        install(python, ros)
    except StepFailed as failure:
        print(failure, file=sys.stderr)
        return 1
    stamp.write_text(wanted)
    say(f"{venv.name} is ready after {time.monotonic() - started:.0f} s")
    return 0


def fingerprint(venv, ros):
    """A hash of all that an environment is made from: it is current while this stays the same."""
    files = [ROOT / "setup.py", ROOT / "pyproject.toml", ROOT / "package.xml", Path(__file__)]
    for folder in ("scripts/nodes", "msg_schemas", "launch", "config"):
        files += sorted(path for path in (ROOT / folder).glob("*") if path.is_file())
    made_from = [str(venv).encode(), str(ROOT).encode(), ros.encode(), sys.version.encode(),
                 *(path.read_bytes() for path in files)]
    return hashlib.sha256(b"\0".join(made_from)).hexdigest()


def usable(venv, ros, python):
    """True if the folder already is an environment of this version of Python, made at this very path.

    Not if it has another ROS 2 distribution: their wheels have the same names, and pip would mix them.
    """
    distributions = {path.name.split("_")[1] for path in venv.glob("lib/python*/site-packages/ros_*_rclpy-*")}
    if not python.exists() or not distributions <= {ros}:
        return False
    answer = subprocess.run([python, "-c", "import sys, pip; print(sys.prefix, *sys.version_info[:2], sep='\\n')"],
                            capture_output=True, text=True)
    return answer.stdout.splitlines() == [str(venv), *map(str, sys.version_info[:2])]


def install(python, ros):
    """Fill the environment: torch first, because which build of it is right depends on the machine."""
    build_in(python.parent.parent / "srt3d-build")
    pip = [python, "-m", "pip", "--disable-pip-version-check", "install", "--progress-bar", "off"]
    if has_nvidia_gpu():
        step("installing torch for CUDA, as there is an NVIDIA GPU (2 to 4 GB, minutes)", [*pip, TORCH])
    else:
        install_cpu_torch(pip)
    step("installing pip and setuptools", [*pip, PIP, SETUPTOOLS])
    step(f"installing ROS 2 {ros.title()}, numba, rerun and the rest (about 500 MB, one or two minutes)",
         [*pip, "--no-build-isolation", "--editable", f".[{ROS_EXTRAS[ros]},{EXTRAS}]"])
    # An editable install leaves data files out, yet `ros2 run` and ament_index look for them.
    step("placing the nodes' executables",
         [python, "setup.py", "--quiet", "install_data", "--install-dir", python.parent.parent])
    step("compiling the kernels for this processor (a minute)", [python.with_name("srt3d"), "compile", "--all"])


def build_in(folder):
    """Let setuptools, as a child of this process, write there and not in the source tree, which may be read-only."""
    folder.mkdir(exist_ok=True)
    config, place = folder / "setup.cfg", str(folder).replace("%", "%%")
    config.write_text(f"[egg_info]\negg_base = {place}\n[build]\nbuild_base = {place}\n", encoding="utf-8")
    os.environ["DIST_EXTRA_CONFIG"] = str(config)


def has_nvidia_gpu():
    if Path("/proc/driver/nvidia/version").exists():
        return True
    smi = shutil.which("nvidia-smi")
    return smi is not None and subprocess.run([smi, "-L"], capture_output=True).returncode == 0


def install_cpu_torch(pip):
    """The CPU build from PyTorch's own index; where that cannot be reached, whatever pip's own sources have."""
    try:
        step("installing torch for the CPU, as there is no NVIDIA GPU (about 200 MB)",
             [*pip, "--no-deps", "--index-url", CPU_INDEX, "--timeout", "10", "--retries", "1", TORCH])
    except StepFailed:
        say(f"{CPU_INDEX} has no {TORCH} for this machine or cannot be reached")
        step("installing torch from the usual package index (it may be the CUDA build: gigabytes)", [*pip, TORCH])


def step(what, command):
    """Run one command, saying what it is for and how long it takes; its output is shown only if it fails."""
    say(what)
    started = time.monotonic()
    with tempfile.TemporaryFile("w+", errors="replace") as output:
        process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=output, stderr=output)
        while True:
            try:
                process.wait(timeout=15)
                break
            except subprocess.TimeoutExpired:
                say(f"  still at it, {time.monotonic() - started:.0f} s")
        if process.returncode != 0:
            output.seek(0)
            raise StepFailed(f"{output.read()}\nFailed: {what}")


def say(text):
    print(f"[venv] {text}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
