"""The one exception for bad input: a message, a file, a parameter or an option that cannot be used."""

LONGEST_VALUE = 80


class InvalidInput(ValueError):
    """Bad input, said in one line: which field, what it is, what was expected.

    Args:
        field: what the user calls the thing: a field, an option, a parameter, a file.
        value: what it is. Long values are shortened.
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
    """The text in one line, its end as dots if it would take more than LONGEST_VALUE characters; escapes stay whole."""
    kept = " ".join(text.split(None, LONGEST_VALUE))[:LONGEST_VALUE + 1]     # the text may be megabytes long
    if len(printable(kept)) <= LONGEST_VALUE:
        return kept
    while len(printable(kept)) > LONGEST_VALUE - 3:
        kept = kept[:-1].rstrip()
    return kept + "..."
