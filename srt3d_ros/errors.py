"""InvalidInput: the one exception for a message, file, parameter or option that cannot be used."""

import math
import reprlib

# Characters shown of each part. Any part may come from the input, or list what is in it.
LONGEST_FIELD, LONGEST_VALUE, LONGEST_SENTENCE = 160, 80, 600
BAD_INPUT = 2           # exit code of a command or node that ends with InvalidInput
DOTS = "..."            # replaces what is left out
MOST_LOOKED_AT = 5      # read this many times the shown length from either end: a value may have megabytes


class InvalidInput(ValueError):
    """Bad input, in one printable line.

    Two forms: `InvalidInput(field, value, expected)` says "field is value: expected …"; use it where `value` is a value
    and `expected` what the user would type. `InvalidInput(field, problem=…)` says the sentence `problem` alone.

    Args:
        field: what the user calls the field, option, parameter or file.
        value: what it is. Long values are shortened in the middle.
        expected: what is accepted, with units.
        problem: a sentence that says what is wrong and what to do.
    """

    def __init__(self, field: str, value: object = None, expected: str = "", problem: str = ""):
        self.field, self.value, self.expected, self.problem = field, value, expected, problem
        if problem:
            line = _shortened(problem, LONGEST_SENTENCE)
        else:
            shown = _shortened(value if isinstance(value, str) else _BRIEFLY.repr(value), LONGEST_VALUE)
            line = (f"{_shortened(field, LONGEST_FIELD)} is {shown or 'empty'}: "
                    f"expected {_shortened(expected, LONGEST_SENTENCE)}")
        super().__init__(printable(line))

    def within(self, name: str) -> "InvalidInput":
        """The same error with `name` in front: of the file that holds the field, say."""
        problem = self.problem and f"{name}: {self.problem}"
        return InvalidInput(f"{name} {self.field}".rstrip(), self.value, self.expected, problem)

    def __reduce__(self):
        """Pickle the value as it is shown: the value itself may not be picklable."""
        value = self.value if isinstance(self.value, str) else _BRIEFLY.repr(self.value)
        return type(self), (self.field, value, self.expected, self.problem)


def require(condition: object, field: str, value: object = None, expected: str = "", problem: str = "") -> None:
    """Raise InvalidInput(field, value, expected, problem) unless the condition holds."""
    if not condition:
        raise InvalidInput(field, value, expected, problem)


def finite(field: str, value: object, expected: str = "a finite number") -> float:
    """`value` as a float that is neither infinite nor NaN, or InvalidInput."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(field, quoted(value), expected) from None
    require(math.isfinite(number), field, quoted(value), expected)
    return number


def quoted(value: object) -> object:
    """The value, strings in quotes: use it where the type may be wrong, since "3" is not 3."""
    return f'"{value}"' if isinstance(value, str) else value


def printable(text: str) -> str:
    """The text in one line, control characters as escapes: input must not control the terminal."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in " ".join(text.split()))


class _Briefly(reprlib.Repr):
    """repr() of a value's beginning: a full one may nest a thousand brackets, or take longer than reading the file."""

    def __init__(self):
        super().__init__()
        self.maxlist = self.maxtuple = self.maxdict = self.maxset = LONGEST_VALUE // 2
        self.maxlevel = self.maxstring = self.maxother = self.maxlong = LONGEST_VALUE

    def repr_bytes(self, value: bytes, level: int) -> str:
        return repr(value[:LONGEST_VALUE + 1])


_BRIEFLY = _Briefly()


def _shortened(text: str, longest: int) -> str:
    """The text in one line. A long one loses its middle: a path's end tells most."""
    most = MOST_LOOKED_AT * longest
    line = printable(text if len(text) <= 2 * most else text[:most] + DOTS + text[-most:])
    half = (longest - len(DOTS)) // 2
    return line if len(line) <= longest else line[:half] + DOTS + line[-half:]
