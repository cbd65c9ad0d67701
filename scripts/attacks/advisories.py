"""The installed packages against known advisories: those of the package index, and of a database on disk if given.

The index is asked about exactly the installed versions; one that answers only for the newest version of a package, as
mirrors do, is believed where that is the installed one. `--database` is a checkout of github.com/pypa/advisory-database
or any folder with OSV files (.yaml, .json).
"""

import argparse
import importlib.metadata
import json
import os
import re
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import yaml
from packaging.version import InvalidVersion, Version
from result import write_result
from tqdm import tqdm

ROOT = Path(__file__).resolve().parents[2]
TIMEOUT_S = 20
AT_ONCE = 4
KNOWN, NEWEST, UNKNOWN = "asked by version", "newest version", "not known"


def main() -> int:
    args = arguments()
    packages = {normal(one.metadata["Name"]): one.version for one in importlib.metadata.distributions()}
    found, answered = {}, dict.fromkeys(packages, UNKNOWN)
    if not args.offline:
        with ThreadPoolExecutor(AT_ONCE) as pool:
            asked = pool.map(lambda item: ask_index(args.index, *item), packages.items())
            for name, answer in zip(packages, tqdm(asked, total=len(packages), unit="package", disable=None)):
                if answer is not None:
                    answered[name], advisories = answer
                    found |= {(name, one["id"]): one.get("summary") or one.get("details", "") for one in advisories}
    database = None
    if args.database:
        database, matches = 0, {}
        for advisory in tqdm(osv_files(args.database), unit="advisory", disable=None):
            database += 1
            for name in affected(advisory, packages):
                matches[name, advisory["id"]] = advisory.get("summary") or advisory.get("details", "")
        found |= matches
    figures = {"packages": len(packages), "advisories": len(found),
               **{how: sum(1 for one in answered.values() if one == how) for how in (KNOWN, NEWEST, UNKNOWN)},
               "advisories_in_database": database}
    write(args, figures, found, packages, answered)
    for (name, advisory), text in sorted(found.items()):
        print(f"{name} {packages[name]}: {advisory}: {' '.join(text.split())[:120]}")
    print(verdict(args, figures))
    return 1 if found or not (figures[KNOWN] + figures[NEWEST] or database) else 0


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--index", default="", metavar="URL", help="of the package index; pip's unless given")
    parser.add_argument("--database", type=Path, metavar="DIR", help="OSV files, such as pypa/advisory-database")
    parser.add_argument("--offline", action="store_true", help="ask no index")
    parser.add_argument("--json", type=Path, default=ROOT / "build" / "attacks" / "advisories.json", metavar="FILE")
    args = parser.parse_args()
    if args.database and not args.database.is_dir():
        parser.error(f"--database is {args.database}: expected a folder")
    args.index = (args.index or pips_index()).rstrip("/").removesuffix("/simple")
    return args


def pips_index() -> str:
    told = subprocess.run([sys.executable, "-m", "pip", "config", "get", "global.index-url"], capture_output=True,
                          text=True)
    return os.environ.get("PIP_INDEX_URL") or told.stdout.strip() or "https://pypi.org/simple"


def ask_index(index: str, name: str, version: str) -> tuple[str, list[dict]] | None:
    """How the index knows a package in its installed version, and its advisories; None if it does not."""
    try:
        return KNOWN, in_force(fetch(f"{index}/pypi/{name}/{version}/json"))
    except (OSError, ValueError):
        pass
    try:
        newest = fetch(f"{index}/pypi/{name}/json")
        return (NEWEST, in_force(newest)) if newest["info"]["version"] == version else None
    except (OSError, ValueError, KeyError):
        return None


def fetch(url: str) -> dict:
    with urllib.request.urlopen(url, timeout=TIMEOUT_S) as answer:
        return json.load(answer)


def in_force(package: dict) -> list[dict]:
    """The advisories of a package that were not withdrawn."""
    return [one for one in package["vulnerabilities"] if not one.get("withdrawn")]


def osv_files(folder: Path) -> Iterator[dict]:
    """All advisories in a folder that were not withdrawn."""
    for path in sorted(folder.rglob("*")):
        if path.suffix in (".yaml", ".yml", ".json") and path.is_file():
            text = path.read_text()
            advisory = json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
            if isinstance(advisory, dict) and "id" in advisory and "withdrawn" not in advisory:
                yield advisory


def affected(advisory: dict, packages: dict[str, str]) -> set[str]:
    """Which of the packages an advisory is about, in their installed versions."""
    found = set()
    for one in advisory.get("affected", ()):
        name = normal(one.get("package", {}).get("name", ""))
        if name in packages and one["package"].get("ecosystem", "PyPI") == "PyPI":
            ranges = [span for span in one.get("ranges", ()) if span.get("type") == "ECOSYSTEM"]
            if packages[name] in one.get("versions", ()) or any(within(packages[name], span) for span in ranges):
                found.add(name)
    return found


def within(version: str, span: dict) -> bool:
    """True if a version lies in a range of OSV: events in their order, each holding from its version on."""
    inside, installed = False, Version(version)
    for event in span.get("events", ()):
        (kind, bound), = event.items()
        try:
            at = Version(bound)
        except InvalidVersion:
            continue
        if kind == "introduced" and installed >= at:
            inside = True
        elif kind == "fixed" and installed >= at or kind == "last_affected" and installed > at:
            inside = False
    return inside


def normal(name: str) -> str:
    """A package's name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def verdict(args: argparse.Namespace, figures: dict) -> str:
    known = figures[KNOWN] + figures[NEWEST]
    sources = [f"{args.index} for {known} of them"] if known else []
    if figures["advisories_in_database"] is not None:
        sources.append(f"a database of {figures['advisories_in_database']} advisories")
    if not sources:
        return f"nothing could be checked: {args.index} cannot be reached or has no advisories; try --database"
    return (f"{figures['advisories']} known advisories for {figures['packages']} installed packages, by "
            + " and ".join(sources))


def write(args: argparse.Namespace, figures: dict, found: dict, packages: dict, answered: dict) -> None:
    write_result(args.json, {
        "seed": None, "figures": figures,
        "advisories": [{"package": name, "version": packages[name], "id": one, "text": text}
                       for (name, one), text in sorted(found.items())],
        "packages": {name: f"{version}, {answered[name]}" for name, version in sorted(packages.items())},
    })


if __name__ == "__main__":
    sys.exit(main())
