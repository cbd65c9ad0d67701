"""Notes to the user, and arrays of files and callers as NumPy arrays of numbers."""

from typing import Any

import numpy as np

from srt3d_ros.core.sketching.photon_frame import COUNT_DTYPES
from srt3d_ros.errors import InvalidInput, finite, require

MAX_EVENTS = 2**28         # of a frame, one by one
WRAPPED = 255, 65_535       # the largest numbers of unsigned types
AT_END, MOST_AT_END = 1 / 16, 0.1       # of a type's numbers; of the counts


class Note(str):
    """A sentence on a value that was assumed: `field` is its name in SensorModel. Once that is given, the note goes."""

    field: str

    def __new__(cls, text: str, field: str = ""):
        """The text as a note on a field."""
        note = super().__new__(cls, text)
        note.field = field
        return note


def outside_note(dropped: int, photons: int, first: int, last: int) -> tuple[str, ...]:
    """The note on photons that a gate drops, if any."""
    note = f"{dropped} of {photons} photons lie outside the gate (bins {first} to {last}): dropped"
    return (note,) if dropped else ()


def channel_of(photons: dict[int, float], wanted: int | None, kind: str = "channel") -> tuple[int, tuple[str, ...]]:
    """The wanted channel, or else the one with the most photons, and then a note; `photons` are those of each."""
    require(len(photons) > 0, "photons", problem="The file has no photons.")
    listed = ", ".join(map(str, photons))
    if wanted is None:
        chosen = max(photons, key=photons.__getitem__)
        note = f"photons of {kind} {chosen}, which has the most, of {listed} (--channel)"
        return chosen, (note,) if len(photons) > 1 else ()
    chosen = int(finite("channel", wanted, f"a {kind}'s number"))
    require(chosen in photons, "channel", chosen, f"one of {listed}")
    return chosen, ()


def array(name: str, values: Any) -> np.ndarray:
    """Values as a NumPy array of numbers; a tensor is copied from its device. Errors call it `name`."""
    require(not np.ma.is_masked(values), name, problem=f"{name} has masked values: fill them or leave them out.")
    try:
        found = np.asarray(values.detach().cpu() if hasattr(values, "detach") else values)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidInput(name, f"{type(values).__name__} ({error})", "an array of numbers") from None
    require(found.dtype.kind in "biuf", f"{name} dtype", str(found.dtype), "numbers")
    return found


def sendable(counts: np.ndarray) -> np.ndarray:
    """Counts in one of COUNT_DTYPES: floats as float32, integers in the smallest type that holds them.

    Raises:
        InvalidInput: many counts lie at the end of 8 or 16 bits and few below: unsigned numbers wrapped.
    """
    high = counts.max() if counts.size else 0
    for most in WRAPPED:
        if most * (1 - AT_END) < high <= most:
            at_end, between = (np.count_nonzero(counts > most * share) for share in (1 - AT_END, AT_END))
            require(at_end < MOST_AT_END * counts.size or between > 2 * at_end, "counts",
                    problem=f"{at_end / counts.size:.0%} of the counts are {high} or little less: unsigned numbers "
                    "wrapped when something was subtracted. Subtract signed ones, counts.astype(np.int32) - dark. Of "
                    "ToA words of a SPAD array, give no_detection (--no-detection).")
    if counts.dtype in COUNT_DTYPES and counts.dtype.isnative:
        return counts
    if counts.dtype.kind == "f":
        return counts.astype(np.float32)
    low, high = (int(counts.min()), int(counts.max())) if counts.size else (0, 0)
    kind = next((kind for kind in COUNT_DTYPES[:-1] if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max), None)
    require(kind is not None, "counts", low if low < 0 else high, "32-bit numbers")
    return counts.astype(kind)
