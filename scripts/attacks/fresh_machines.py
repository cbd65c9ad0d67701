"""The two commands of the README, from a clean clone, on machines that have nothing: a matrix of cases.

Every case gets a clone of the committed state (or an sdist of it) in a folder of its own, an empty HOME and no
environment but PATH, HOME and the way to the package index (PIP_*, proxies, certificates). Where this script is root it
also gets a user without an account, an empty /tmp and /dev/shm and a file system on which all else but its folder is
read-only, with the home of whoever runs the script hidden. What a case leaves running or in /tmp and /dev/shm is told.
"""

import argparse
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from result import write_result
from tqdm import tqdm

ROOT = Path(__file__).resolve().parents[2]
UID = 23111                     # no account has it; each case adds its place in the table
QUICK = ("tests/messages tests/core/test_sensor.py tests/cli tests/test_new_files.py tests/test_make_venv.py "
         "tests/test_install.py tests/nodes/test_pipeline.py tests/recording/test_parts.py")
KEEP = ("http_proxy", "https_proxy", "no_proxy", "HTTP_PROXY", "HTTPS_PROXY", "NO_PROXY", "SSL_CERT_FILE",
        "SSL_CERT_DIR", "REQUESTS_CA_BUNDLE")
OWN = {"tmp": "/tmp", "shm": "/dev/shm"}        # folders of the case, and where it sees them
TIMEOUT_S = 3600
# What others keep there by design: the tracing library one page for each user, torch a cache for each, pytest the last
# three runs; Fast DDS its ports for the next process, which also removes what a process that a test killed has left.
KEPT = ("lttng-ust-wait-", "torchinductor_", "pytest-of-", "fastrtps_", "sem.fastrtps_port")
TAIL = 25


@dataclass(frozen=True)
class Case:
    """A machine. `folder` is the clone's name; `offline`: without a network once `make venv` is done."""

    what: str
    python: str = "3.11"
    folder: str = "srt3d_ros"
    root: bool = False
    offline: bool = False
    read_only: bool = False
    sdist: bool = False

    @property
    def needs_root(self) -> bool:
        return self.root or self.offline or self.read_only


CASES = {
    "plain": Case("a user without root, Python 3.11"),
    "python312": Case("the same with Python 3.12", python="3.12"),
    "root": Case("as root, as in a container", root=True),
    "offline": Case("no network after the installation", offline=True),
    "path": Case("a path with spaces and letters of three scripts", folder="Łidar für 光子/my srt3d ros"),
    "readonly": Case("a read-only checkout, VENV and OUT elsewhere", read_only=True),
    "sdist": Case("an unpacked sdist, no git", sdist=True),
}


@dataclass
class Result:
    """What one case did: seconds and exit code by command, and the tail of the log of one that failed."""

    case: str
    what: str
    python: str = ""
    revision: str = ""
    skipped: str = ""
    seconds: dict[str, float] = field(default_factory=dict)
    codes: dict[str, int] = field(default_factory=dict)
    tests: str = ""
    left_behind: list[str] = field(default_factory=list)
    tail: str = ""

    @property
    def good(self) -> bool:
        return not self.skipped and not any(self.codes.values()) and not self.left_behind


def main() -> int:
    args = arguments()
    results = []
    for name in (bar := tqdm(args.cases, unit="case", disable=None)):
        bar.set_postfix_str(name)
        results.append(Attempt(name, args).run())
        tqdm.write(row(results[-1]), file=sys.stderr)
    print(table(results))
    for result in results:
        if result.tail:
            print(f"\n--- {result.case}: the end of its log\n{result.tail}")
    write_result(args.json, report(args, results))
    bad = [result.case for result in results if not result.good and not result.skipped]
    skipped = [result.case for result in results if result.skipped]
    print(f"\n{len(results) - len(bad) - len(skipped)} of {len(results)} cases pass"
          + (f"; failed: {', '.join(bad)}" if bad else "") + (f"; not tried: {', '.join(skipped)}" if skipped else ""))
    return 1 if bad else 0


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=lambda text: text.split(","), default=list(CASES), metavar="A,B",
                        help="of " + ", ".join(CASES))
    parser.add_argument("--demo-only", action="store_true", help="no make test")
    parser.add_argument("--test-only", action="store_true", help="no make demo")
    parser.add_argument("--quick", action="store_true", help="make test with a part of the tests")
    parser.add_argument("--pip-cache", type=Path, metavar="DIR", help="share downloads between the cases")
    parser.add_argument("--python", action="append", default=[], metavar="PATH", help="an interpreter to prefer")
    parser.add_argument("--work", type=Path, default=Path("/var/tmp"), metavar="DIR", help="where the cases live")
    parser.add_argument("--keep", action="store_true", help="do not remove the folders of the cases")
    parser.add_argument("--json", type=Path, default=ROOT / "build" / "attacks" / "fresh_machines.json", metavar="FILE")
    args = parser.parse_args()
    if unknown := set(args.cases) - set(CASES):
        parser.error(f"--cases: {', '.join(sorted(unknown))}: expected some of {', '.join(CASES)}")
    return args


class Attempt:
    """One case, from its clone to its result."""

    def __init__(self, name: str, args: argparse.Namespace):
        self.name, self.case, self.args = name, CASES[name], args
        self.uid = None if self.case.root or os.geteuid() else UID + list(CASES).index(name)
        self.result = Result(name, self.case.what)

    def run(self) -> Result:
        python = interpreter(self.case.python, self.args.python)
        if self.case.needs_root and os.geteuid():
            self.result.skipped = "needs root"
        elif python is None:
            self.result.skipped = f"no Python {self.case.python} with venv here"
        else:
            self.python, self.result.python = python, ask(python, "import platform; print(platform.python_version())")
            self.place = Path(tempfile.mkdtemp(prefix=f"srt3d-fresh-{self.name}-", dir=self.args.work))
            try:
                self.prepare()
                self.commands()
                self.result.left_behind = self.left_behind()
            finally:
                if os.geteuid() == 0:
                    subprocess.run(["umount", self.place / "shm"], check=False)
                if not self.args.keep:
                    shutil.rmtree(self.place, ignore_errors=True)
        return self.result

    def prepare(self) -> None:
        """Lay out the folder: the checkout, empty home and /tmp; all but a read-only checkout is the user's."""
        self.checkout = self.place / self.case.folder
        for folder in ("home", *OWN):
            (self.place / folder).mkdir()
        if os.geteuid() == 0:
            subprocess.run(["mount", "-t", "tmpfs", "-o", "mode=1777,size=1g", "tmpfs", self.place / "shm"], check=True)
        subprocess.run(["git", "clone", "--quiet", f"file://{ROOT}", self.checkout], check=True)
        revision = subprocess.run(["git", "-C", self.checkout, "rev-parse", "--short=12", "HEAD"], check=True,
                                  capture_output=True, text=True)
        self.result.revision = revision.stdout.strip()
        if self.case.sdist:
            self.unpack_sdist()
        if self.uid is not None:
            shutil.chown(self.place, self.uid, self.uid)
            own = ["home", "tmp"] + ([] if self.case.read_only else [Path(self.case.folder).parts[0]])
            subprocess.run(["chown", "-R", f"{self.uid}:{self.uid}", *own], cwd=self.place, check=True)
            if self.args.pip_cache:
                self.args.pip_cache.mkdir(parents=True, exist_ok=True)
                subprocess.run(["chown", "-R", f"{self.uid}:{self.uid}", self.args.pip_cache], check=True)

    def unpack_sdist(self) -> None:
        subprocess.run([sys.executable, "setup.py", "--quiet", "sdist", "--dist-dir", self.place / "dist"],
                       cwd=self.checkout, check=True)
        (archive,) = (self.place / "dist").iterdir()
        shutil.rmtree(self.checkout)
        self.checkout.mkdir()
        subprocess.run(["tar", "--strip-components=1", "-xf", archive, "-C", self.checkout], check=True)

    def commands(self) -> None:
        """`make demo` and `make test`, one after the other; a failure of the first does not spare the second."""
        common = [f"PYTHON={self.python}"]
        if self.case.read_only:
            common += [f"VENV={self.place}/home/venv", f"OUT={self.place}/home/demo-out"]
        if self.case.offline:
            self.command("venv", ["make", "venv", *common])
        if not self.args.test_only:
            self.command("demo", ["make", "demo", *common], self.case.offline)
        if not self.args.demo_only:
            only = [f"ARGS={QUICK}"] if self.args.quick else []
            self.command("test", ["make", "test", *common, *only], self.case.offline)

    def command(self, what: str, command: list[str], offline: bool = False) -> None:
        started, log = time.monotonic(), self.place / f"{what}.log"
        with open(log, "wb") as output:
            try:
                code = subprocess.run(self.inside(command, offline), cwd=self.checkout, stdin=subprocess.DEVNULL,
                                      stdout=output, stderr=output, timeout=TIMEOUT_S).returncode
            except subprocess.TimeoutExpired:
                code = 124
        lines = log.read_text(errors="replace").splitlines()
        self.result.seconds[what], self.result.codes[what] = round(time.monotonic() - started, 1), code
        if what == "test" and lines:
            self.result.tests = lines[-1].strip("= ") if not code else ""
        if code:
            self.result.tail += "\n".join([f"$ {' '.join(command)}", *lines[-TAIL:], ""])

    def inside(self, command: list[str], offline: bool) -> list[str]:
        """The command as the case runs it: in an empty environment and, as root, in namespaces of its own."""
        variables = {"PATH": "/usr/local/bin:/usr/bin:/bin", "HOME": f"{self.place}/home",
                     **{key: value for key, value in os.environ.items() if key in KEEP or key.startswith("PIP_")}}
        if self.args.pip_cache:
            variables["PIP_CACHE_DIR"] = str(self.args.pip_cache.resolve())
        bare = ["env", "-i", *(f"{key}={value}" for key, value in variables.items()), *command]
        if os.geteuid():
            return bare
        if self.uid is not None:
            bare = ["setpriv", f"--reuid={self.uid}", f"--regid={self.uid}", "--clear-groups", "--", *bare]
        return ["unshare", "--mount", *(["--net"] if offline else []), "sh", "-ec", self.prelude(offline), "sh", *bare]

    def prelude(self, offline: bool) -> str:
        """Shell commands, run as root in new namespaces, that take away what a fresh machine does not have."""
        prefix, home = Path(ask(self.python, "import sys; print(sys.base_prefix)")), Path.home()
        lines = ["ip link set lo up"] if offline else []
        writable = [self.place, *([self.args.pip_cache.resolve()] if self.args.pip_cache else [])]
        lines += [f"mount --bind '{self.place}/{own}' {place}" for own, place in OWN.items()]
        lines += [f"mount --bind '{path}' '{path}'" for path in writable]
        if prefix.is_relative_to(home):
            lines += ["mkdir -p /tmp/.python", f"mount --bind '{prefix}' /tmp/.python"]
        lines.append(f"mount -t tmpfs -o mode=755 tmpfs '{home}'")
        if prefix.is_relative_to(home):
            lines += [f"mkdir -p '{prefix}'", f"mount --move /tmp/.python '{prefix}'", "rmdir /tmp/.python"]
        if self.case.read_only:
            lines += [f"mount --bind '{self.checkout}' '{self.checkout}'",
                      f"mount -o remount,bind,ro '{self.checkout}'"]
        return "\n".join([*lines, "mount -o remount,bind,ro /", f"cd '{self.checkout}'", 'exec "$@"'])

    def left_behind(self) -> list[str]:
        """Processes of the case's user, and files in its /tmp and /dev/shm, a second after its last command."""
        time.sleep(1)
        found = [str(Path(place, path.name)) for own, place in OWN.items() for path in (self.place / own).iterdir()]
        if self.uid is not None:
            running = subprocess.run(["ps", "-o", "pid=,args=", "-u", str(self.uid)], capture_output=True, text=True)
            found += [f"process {line.strip()}" for line in running.stdout.splitlines()]
        return sorted(name for name in found if not Path(name).name.startswith(KEPT))


def interpreter(wanted: str, given: list[str]) -> str | None:
    """A Python of this version that can make virtual environments: given, on PATH, or of pyenv."""
    for python in [*given, shutil.which(f"python{wanted}"),
                   *sorted(Path.home().glob(f".pyenv/versions/{wanted}.*/bin/python{wanted}"))]:
        if python and ask(python, "import ensurepip, platform, venv; print(platform.python_version())").startswith(
                f"{wanted}."):
            return ask(python, "import sys; print(sys.executable)")      # what is on PATH may be a script that finds it
    return None


def ask(python: str | Path, program: str) -> str:
    """What a program of one line prints; nothing if it fails."""
    return subprocess.run([python, "-c", program], capture_output=True, text=True).stdout.strip()


def row(result: Result) -> str:
    if result.skipped:
        return f"| {result.case} | {result.what} | | not tried: {result.skipped} | | |"
    cells = [f"{result.codes[what]} ({result.seconds[what]:.0f} s)" if what in result.codes else ""
             for what in ("venv", "demo", "test")]
    left = "; ".join(result.left_behind) or "nothing"
    return f"| {result.case} | {result.what} | {result.python} | {' | '.join(cells)} | {result.tests} | {left} |"


def table(results: list[Result]) -> str:
    return "\n".join(["| case | machine | Python | make venv | make demo | make test | tests | left behind |",
                      "|---|---|---|---|---|---|---|---|", *map(row, results)])


def report(args: argparse.Namespace, results: list[Result]) -> dict:
    return {"seed": None, "system": platform.platform(), "as_root": os.geteuid() == 0, "quick": args.quick,
            "results": [vars(result) | {"good": result.good} for result in results]}


if __name__ == "__main__":
    sys.exit(main())
