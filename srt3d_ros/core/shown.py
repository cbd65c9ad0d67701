"""How results show themselves: the number of their notes in a text, and a picture in a notebook."""

import base64
import html
import io
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from PIL.Image import Image

COLOURS = 64                # of a picture: 6 bits a pixel keep one of 320 × 240 below 60 kB whatever it shows
SIZE_PX = 320, 240


def notes_text(notes: Sequence[str]) -> str:
    """The end of a text: "; 2 notes", or nothing."""
    return f"; {len(notes)} note{'s' if len(notes) > 1 else ''}" if notes else ""


def as_html(text: str, draw: Callable[[], "Image"]) -> str:
    """The text with a picture of SIZE_PX below it; the text alone if a package for drawing is missing."""
    words, file = f"<pre>{html.escape(text)}</pre>", io.BytesIO()
    try:
        draw().convert("RGB").quantize(COLOURS).save(file, "PNG", optimize=True)
    except ImportError:
        return words
    return f'{words}<img alt="" src="data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}">'
