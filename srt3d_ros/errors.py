"""The one exception for bad input: a message, a file, a parameter or an option that cannot be used."""


class InvalidInput(ValueError):
    """Bad input, said in one line: which field, what it is, what was expected.

    Args:
        field: what the user calls the thing: a field, an option, a parameter, a file.
        value: what it is. Long values are shortened.
        expected: what would have been accepted, with units; it may also say what to do next.
    """

    def __init__(self, field: str, value: object, expected: str):
        self.field, self.value, self.expected = field, value, expected
        shown = value if isinstance(value, str) else repr(value)
        shown = " ".join(shown.split())
        if len(shown) > 80:
            shown = shown[:77] + "..."
        super().__init__(f"{field} is {shown or 'empty'}: expected {expected}")


def require(condition: bool, field: str, value: object, expected: str) -> None:
    """Raise InvalidInput(field, value, expected) unless the condition holds."""
    if not condition:
        raise InvalidInput(field, value, expected)
