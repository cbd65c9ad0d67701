"""Write numbers and quantities for people: in pictures, on the terminal and in reports."""


def number_text(value: float, digits: int = 3) -> str:
    """A number with so many digits, whole if it has more before the point: 0.569, 19,871."""
    is_whole = value == value // 1 or abs(value) >= 10**digits
    return f"{value:,.0f}" if is_whole else f"{value:.{digits}g}"


def length_text(metres: float) -> str:
    """A length with three digits in a suitable unit: 2 m, 50 cm, 5 mm."""
    metres = float(f"{metres:.3g}")
    if metres >= 1:
        return f"{metres:g} m"
    return f"{metres * 100:g} cm" if metres >= 0.01 else f"{metres * 1000:g} mm"


def duration_text(seconds: float) -> str:
    """Seconds, or minutes and seconds: 2.9 s, 5 min 0 s."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{seconds:.3g} s"


def size_text(number: int) -> str:
    """Bytes in MB, or in GB."""
    return f"{number / 1e6:,.1f} MB" if number < 1e9 else f"{number / 1e9:,.2f} GB"
