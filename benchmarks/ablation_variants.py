"""The variants of ablation.py: each constant of `pooled` halved, doubled and, where that says something, off."""

import math
import sys
from dataclasses import dataclass, field
from fnmatch import fnmatch
from importlib import import_module

CONSTANTS = "srt3d_ros.kernels.constants"
FIXED = ("MAX_SKETCH_SIZE", "MAX_PHOTONS",      # limits
         "FINE", "CELL", "RIDGE",               # the grid of the pool, which fits together, and rounding
         "INTENSITY_RATE", "APSS_*",            # of the baselines
         "STAY")                                # of warm_start
NONE, ANY = 0, 1e6
OFF = {"FAINTEST": NONE, "APART": -1, "WEAK": NONE, "LEAST_SHARE": NONE, "DEAD_PIXEL": -ANY, "LIKENESS": ANY,
       "VOTE_SIGMA": ANY, "PRIOR_VOTE": NONE, "MAX_VOTE": ANY, "EMPTY_PENALTY": NONE, "FEWER_PENALTY": NONE,
       "BIRTH": NONE, "JUDGED": 1, "RESOLVED": NONE, "SPREAD": NONE}
MOST = {"WINDOWS[:, 1]": 16}                    # maps.MARGIN: beyond it kernels read other memory
FEATURES = (("warm_start", {"warm_start": True}),)


@dataclass(frozen=True)
class Variant:
    """The default, one constant (`where`.`name`) with another value, or other options of the method."""

    label: str
    where: str = ""
    name: str = ""
    value: object = None
    options: dict = field(default_factory=dict)


def variants_of_constants(patterns: list[str]) -> list[Variant]:
    """Each number of each constant halved, doubled and off."""
    varied = [variant for where, name, value in constants() for variant in variants_of(where, name, value)]
    for pattern in filter(None, patterns):
        if not any(fnmatch(variant.name, pattern) for variant in varied):
            names = ", ".join(dict.fromkeys(variant.name for variant in varied))
            sys.exit(f"--constants {pattern}: expected some of {names}")
    return [variant for variant in varied if any(fnmatch(variant.name, pattern) for pattern in patterns)]


def constants() -> list[tuple[str, str, object]]:
    """Module, name and value of each constant that can be varied."""
    module = import_module(CONSTANTS)
    return [(CONSTANTS, name, value) for name, value in vars(module).items()
            if name.isupper() and not any(fnmatch(name, pattern) for pattern in FIXED)]


def variants_of(where: str, name: str, value) -> list[Variant]:
    """A constant's variants; one that equals the default or another is left out."""
    variants = []
    for suffix, numbers, rebuild in parts(value):
        part, tried = name + suffix, [numbers]
        changes = [half, lambda number: 2 * number]
        changes += [lambda number: type(number)(OFF[part])] if part in OFF else []
        for change in changes:
            new = tuple(min(change(number), MOST.get(part, math.inf)) for number in numbers)
            if new not in tried:
                tried.append(new)
                change_text = " → ".join(", ".join(f"{number:g}" for number in several) for several in (numbers, new))
                variants.append(Variant(f"{part}: {change_text}", where, name, rebuild(new)))
    return variants


def parts(value) -> list[tuple]:
    """The numbers of a constant that change together: (index in words, the numbers, constant with others in place).

    A number; each number of a tuple; each column of a tuple of tuples.
    """
    def is_number(item):
        return isinstance(item, (int, float)) and not isinstance(item, bool)

    def put(items, k, new):
        return (*items[:k], new, *items[k + 1:])

    if is_number(value):
        return [("", (value,), lambda new: new[0])]
    if not isinstance(value, tuple) or not value:
        return []
    if all(map(is_number, value)):
        return [(f"[{k}]", (value[k],), lambda new, k=k: put(value, k, new[0])) for k in range(len(value))]
    if not all(isinstance(row, tuple) and len(row) == len(value[0]) and all(map(is_number, row)) for row in value):
        return []
    return [(f"[:, {k}]", tuple(row[k] for row in value),
             lambda new, k=k: tuple(put(row, k, number) for row, number in zip(value, new)))
            for k in range(len(value[0]))]


def half(number):
    """Half of it; of an integer at least 1."""
    return max(1, round(number / 2)) if isinstance(number, int) else number / 2
