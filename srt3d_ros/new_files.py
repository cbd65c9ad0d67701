"""Files that take their place only when they are whole, and names for those that must not take another's place."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path


@contextmanager
def appearing_whole(path: Path) -> Iterator[Path]:
    """A path beside `path`, with its suffix, to write to: it becomes `path` if the block ends well, else it is gone."""
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield part
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def next_free(path: Path) -> Path:
    """The first of NAME_2, NAME_3, … beside `path`, with its suffix, where nothing is."""
    return next(other for k in count(2) if not (other := path.with_stem(f"{path.stem}_{k}")).exists())
