"""Key: what is said of an option or of a field of the sensor, once for checks, files, command line and documents."""

import inspect
from collections.abc import Callable, Iterable
from dataclasses import MISSING, dataclass, is_dataclass, replace
from functools import cache
from numbers import Real
from textwrap import fill
from types import NoneType
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

from srt3d_ros.errors import finite, quoted, require

UNIT_WORDS = {"1": "", "any": "", "bin": "bins", "pixel": "pixels"}
WIDTH = 116             # of a docstring
T = TypeVar("T")
Function = TypeVar("Function", bound=Callable)


@dataclass(frozen=True)
class Key:
    """An option or a field, as its annotation: `rows: Annotated[int, Key("row 0 is the top row")]`.

    Args:
        about: what it means, in a clause.
        unit: of a number, as the documents call it; "any" if only ratios count, "1" if it has none.
        bounds: the least and the most that a number, or each number of an array, may be.
        more: what documents add to `about`.
        choices: all that a text may be.
        form: what a text may be, in words.
        dtype, shape: of an array; shape in words, such as "[rows, cols]".
        array: the name in .npz files, if it is another: of an object, the array with its numbers.
        option: whether the command line has it.
        needed: whether JSON must have it although the class has a default.
        default: of an option; that of a field stands in its class.
        name, kinds, required: filled in by `keys`: kinds are the types that a value may have.
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
    choices: tuple[str, ...] = ()
    form: str = ""
    default: Any = None
    name: str = ""
    kinds: tuple[type, ...] = ()
    required: bool = False

    @property
    def meaning(self) -> str:
        """The sentence of the documents: meaning, bounds, default."""
        parts = [f"{self.shape}, {self.about}" if self.shape else self.about]
        if self.bounds and self.dtype != "bool":
            parts.append("{:.6g} to {:.6g}".format(*self.bounds))
        parts += [", ".join(self.choices), self.more]
        if isinstance(self.default, int | float | str) and not self.needed:
            parts.append(f"default {self.default}".removesuffix(".0"))
        return "; ".join(filter(None, parts))

    @property
    def expected(self) -> str:
        """What a value must be, in words."""
        if self.choices or self.form:
            return self.form or " or ".join(self.choices)
        if self.kinds == (bool,):
            return "true or false"
        unit = UNIT_WORDS.get(self.unit, self.unit)
        if self.bounds is None:
            return "an integer" if int in self.kinds else f"a finite number of {unit}".removesuffix(" of ")
        low, high = self.bounds
        if int in self.kinds:
            return f"an integer from {low} to {high}"
        return f"{low:g} to {high:g} {unit}".rstrip()

    def check(self, value: Any) -> Any:
        """The value of an option, or InvalidInput."""
        if self.choices or self.kinds == (bool,):
            require(value in (self.choices or (True, False)), self.name, value, self.expected)
            return value
        require(isinstance(value, Real), self.name, quoted(value), self.expected)
        return self.number(value)

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
            default = kind.__dataclass_fields__[name].default if is_dataclass(kind) else key.default
            missing = default is MISSING
            found[name] = replace(key, name=name, kinds=kinds, default=None if missing else default,
                                  required=missing or key.needed)
    return found


def numbers(part: Any, prefix: str = "") -> dict[str, float]:
    """The checked numbers of a sensor or of a part of one, by field, without those that are None."""
    given = ((key, getattr(part, name)) for name, key in keys(type(part)).items() if key.kinds in ((int,), (float,)))
    return {key.name: key.number(value, prefix) for key, value in given
            if value is not None or key.default is not None or key.required}


def about(kind: type) -> str:
    """What the docstring of a class says before its arguments, in one line."""
    return " ".join((inspect.getdoc(kind) or "").partition("Args:")[0].split())


def documented(kind: type[T]) -> type[T]:
    """Add the keys of a dataclass to its docstring, and leave plain types in its signature."""
    kind.__doc__ = _with_arguments(kind, keys(kind).values())
    kind.__init__.__annotations__ |= get_type_hints(kind)
    return kind


def written_out(*kinds: type) -> Callable[[Function], Function]:
    """A decorator of a function: add the keys of these TypedDicts to its docstring, and show the names of its options.

    `**options: Unpack[Options]` becomes one argument for each option in what help() and documents show.
    """
    def decorate(function: Function) -> Function:
        function.__doc__ = _with_arguments(function, [key for kind in kinds for key in keys(kind).values()])
        signature = inspect.signature(function)
        *arguments, options = signature.parameters.values()
        if options.kind is options.VAR_KEYWORD:
            of_options, = get_args(options.annotation)
            known = keys(of_options)
            arguments += [options.replace(name=name, kind=options.KEYWORD_ONLY, annotation=hint,
                                          default=known[name].default if name in known else None)
                          for name, hint in get_type_hints(of_options).items() if name not in signature.parameters]
            function.__signature__ = signature.replace(parameters=arguments)
        return function

    return decorate


def _with_arguments(documented: Any, own: Iterable[Key]) -> str:
    """A docstring with these keys at the end of its arguments."""
    lines = ""
    for key in own:
        unit = UNIT_WORDS.get(key.unit, key.unit)
        line = f"{key.name}: {unit}{'; ' * bool(unit)}{key.meaning}."
        lines += fill(line, WIDTH, initial_indent=4 * " ", subsequent_indent=8 * " ") + "\n"
    text = inspect.getdoc(documented) or ""
    section = min((at for at in map(text.find, ("Returns:", "Raises:")) if at >= 0), default=len(text))
    before, after = text[:section].rstrip(), text[section:]
    begin = "\n" if "Args:" in before else "\n\nArgs:\n"
    return f"{before}{begin}{lines}" + (f"\n{after}" if after else "")
