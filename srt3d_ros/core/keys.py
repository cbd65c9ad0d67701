"""Key: what is said of a field of the sensor, once for checks, JSON Schema, files, command line and documents."""

import inspect
from dataclasses import MISSING, dataclass, is_dataclass, replace
from functools import cache
from types import NoneType
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

from srt3d_ros.errors import finite, quoted, require

UNIT_WORDS = {"1": "", "any": "", "bin": "bins", "pixel": "pixels"}
T = TypeVar("T")


@dataclass(frozen=True)
class Key:
    """A field of a sensor, as the annotation of that field: `rows: Annotated[int, Key("row 0 is the top row")]`.

    Args:
        about: what the field means, in a clause.
        unit: of a number, as the documents call it; "any" if only ratios count, "1" if it has none.
        bounds: the least and the most that a number, or each number of an array, may be.
        more: what documents add to `about`.
        dtype, shape: of an array; shape in words, such as "[rows, cols]".
        array: the name in .npz files, if it is another: of an object, the array with its numbers.
        option: whether the command line has it.
        needed: whether JSON must have it although the class has a default.
        name, kinds, default, required: filled in by `keys`: kinds are the types that a value may have.
    """

    about: str
    unit: str = ""
    bounds: tuple[float, float] | None = None
    more: str = ""
    dtype: str = ""
    shape: str = ""
    array: str = ""
    option: bool = False
    needed: bool = False
    name: str = ""
    kinds: tuple[type, ...] = ()
    default: Any = None
    required: bool = False

    @property
    def meaning(self) -> str:
        """The sentence of the documents: meaning, bounds, default."""
        parts = [f"{self.shape}, {self.about}" if self.shape else self.about]
        if self.bounds and self.dtype != "bool":
            parts.append("{:.6g} to {:.6g}".format(*self.bounds))
        parts.append(self.more)
        if isinstance(self.default, int | float | str) and not self.needed:
            parts.append(f"default {self.default}".removesuffix(".0"))
        return "; ".join(filter(None, parts))

    @property
    def expected(self) -> str:
        """What a number must be, in words."""
        unit = UNIT_WORDS.get(self.unit, self.unit)
        if self.bounds is None:
            return "an integer" if int in self.kinds else f"a finite number of {unit}".removesuffix(" of ")
        low, high = self.bounds
        if int in self.kinds:
            return f"an integer from {low} to {high}"
        return f"{low:g} to {high:g} {unit}".rstrip()

    def number(self, value: Any, prefix: str = "") -> float:
        """`value` as an int or float within the bounds; InvalidInput names the field, with `prefix` in front."""
        name = prefix + self.name
        number = finite(name, value, self.expected)
        low, high = self.bounds or (-float("inf"), float("inf"))
        require(low <= number <= high, name, quoted(value), self.expected)
        if int in self.kinds:
            require(number == int(number), name, quoted(value), self.expected)
            return int(number)
        return number


@cache
def keys(kind: type) -> dict[str, Key]:
    """The keys of a class whose fields are annotated with them, by name, in the order of the fields."""
    found = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if get_origin(hint) is Annotated:
            plain, key = get_args(hint)
            kinds = tuple(one for one in get_args(plain) or (plain,) if one is not NoneType)
            default = kind.__dataclass_fields__[name].default if is_dataclass(kind) else None
            missing = default is MISSING
            found[name] = replace(key, name=name, kinds=kinds, default=None if missing else default,
                                  required=missing or key.needed)
    return found


def numbers(part: Any, prefix: str = "") -> dict[str, float]:
    """The checked numbers of a sensor or of a part of one, by field, without those that are None."""
    found = {}
    for name, key in keys(type(part)).items():
        value = getattr(part, name)
        optional = key.default is None and not key.required
        if key.kinds in ((int,), (float,)) and not (value is None and optional):
            found[name] = key.number(value, prefix)
    return found


def about(kind: type) -> str:
    """What the docstring of a class says before its arguments, in one line."""
    return " ".join(inspect.getdoc(kind).partition("Args:")[0].split())


def documented(kind: type[T]) -> type[T]:
    """Add the keys of a dataclass to its docstring, and leave plain types in its signature."""
    units = {name: UNIT_WORDS.get(key.unit, key.unit) for name, key in keys(kind).items()}
    lines = "".join(f"    {name}: {units[name]}{'; ' * bool(units[name])}{key.meaning}.\n"
                    for name, key in keys(kind).items())
    before, raises, after = inspect.getdoc(kind).partition("Raises:")
    kind.__doc__ = f"{before.rstrip()}\n\nArgs:\n{lines}" + (f"\n{raises}{after}" if raises else "")
    kind.__init__.__annotations__ |= get_type_hints(kind)
    return kind
