"""The one exception for bad input: a message, a file, a parameter or an option that cannot be used."""

import math
import reprlib

# Characters that are shown of each part: all three may come from the input, or list what is in it.
LONGEST_FIELD, LONGEST_VALUE, LONGEST_EXPECTED = 160, 80, 600
DOTS = "..."            # for what is left out
MOST_LOOKED_AT = 5      # times what is shown, of either end: a value may be megabytes long


class InvalidInput(ValueError):
    """Bad input, said in one line: which field, what it is, what was expected.

    Args:
        field: what the user calls the thing: a field, an option, a parameter, a file.
        value: what it is. Long values are shortened in the middle.
        expected: what would have been accepted, with units; it may also say what to do next.
    """

    def __init__(self, field: str, value: object, expected: str):
        self.field, self.value, self.expected = field, value, expected
        shown = _shortened(value if isinstance(value, str) else _BRIEFLY.repr(value), LONGEST_VALUE)
        super().__init__(printable(f"{_shortened(field, LONGEST_FIELD)} is {shown or 'empty'}: "
                                   f"expected {_shortened(expected, LONGEST_EXPECTED)}"))

    def __reduce__(self):
        """For errors of other processes: the value as it is shown, since nobody knows whether it can be pickled."""
        return type(self), (self.field, self.value if isinstance(self.value, str) else _BRIEFLY.repr(self.value),
                            self.expected)


def require(condition: bool, field: str, value: object, expected: str) -> None:
    """Raise InvalidInput(field, value, expected) unless the condition holds."""
    if not condition:
        raise InvalidInput(field, value, expected)


def finite(field: str, value: object, expected: str = "a finite number") -> float:
    """`value` as a float that is neither infinite nor NaN, or InvalidInput."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(field, quoted(value), expected) from None
    require(math.isfinite(number), field, quoted(value), expected)
    return number


def quoted(value: object) -> object:
    """The value, a string in quotes: for values whose type may be what is wrong, since "3" is not 3."""
    return f'"{value}"' if isinstance(value, str) else value


def printable(text: str) -> str:
    """The text in one line, control characters as escapes: what an input holds must not command the terminal."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in " ".join(text.split()))


class _Briefly(reprlib.Repr):
    """repr() of the beginning: the whole may be brackets a thousand deep, or take longer than reading the value."""

    def __init__(self):
        super().__init__()
        self.maxlist = self.maxtuple = self.maxdict = self.maxset = LONGEST_VALUE // 2
        self.maxlevel = self.maxstring = self.maxother = self.maxlong = LONGEST_VALUE

    def repr_bytes(self, value: bytes, level: int) -> str:
        return repr(value[:LONGEST_VALUE + 1])


_BRIEFLY = _Briefly()


def _shortened(text: str, longest: int) -> str:
    """The text in one line; of one too long the two ends, since a path's end tells most."""
    most = MOST_LOOKED_AT * longest
    line = printable(text if len(text) <= 2 * most else text[:most] + DOTS + text[-most:])
    half = (longest - len(DOTS)) // 2
    return line if len(line) <= longest else line[:half] + DOTS + line[-half:]
