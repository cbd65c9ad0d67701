"""The one exception for bad input: a message, a file, a parameter or an option that cannot be used."""

from itertools import accumulate

LONGEST_VALUE = 80      # characters of a value that are shown
DOTS = "..."            # for what is left out
MOST_LOOKED_AT = 400    # of either end: a value may be megabytes long


class InvalidInput(ValueError):
    """Bad input, said in one line: which field, what it is, what was expected.

    Args:
        field: what the user calls the thing: a field, an option, a parameter, a file.
        value: what it is. Long values are shortened in the middle.
        expected: what would have been accepted, with units; it may also say what to do next.
    """

    def __init__(self, field: str, value: object, expected: str):
        self.field, self.value, self.expected = field, value, expected
        shown = _shortened(value if isinstance(value, str) else repr(value))
        super().__init__(printable(f"{field} is {shown or 'empty'}: expected {expected}"))


def require(condition: bool, field: str, value: object, expected: str) -> None:
    """Raise InvalidInput(field, value, expected) unless the condition holds."""
    if not condition:
        raise InvalidInput(field, value, expected)


def printable(text: str) -> str:
    """The text in one line, control characters as escapes: what an input holds must not command the terminal."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in " ".join(text.split()))


def _shortened(text: str) -> str:
    """The text in one line; of one too long the two ends, since a path's end tells most. Escapes stay whole."""
    if len(text) <= MOST_LOOKED_AT and len(printable(text)) <= LONGEST_VALUE:
        return " ".join(text.split())
    half = (LONGEST_VALUE - len(DOTS)) // 2
    head, tail = " ".join(text[:MOST_LOOKED_AT].split()), " ".join(text[-MOST_LOOKED_AT:].split())
    return _fitting(head, half) + DOTS + _fitting(tail[::-1], half)[::-1]


def _fitting(text: str, room: int) -> str:
    """As much of the text's beginning as takes no more than so many printable characters."""
    taken = accumulate(len(printable(character)) or 1 for character in text[:room])
    return text[:sum(1 for length in taken if length <= room)]
