"""Read an impulse response (IRF) from a file, and bring it into the bins of the data."""

import math
import re
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.sensor.model import MAX_BINS, SensorModel
from srt3d_ros.datasets.values import Note, array, channel_of
from srt3d_ros.errors import finite, require
from srt3d_ros.files import isolated, tcspc_files
from srt3d_ros.files.array_files import map_npy, read_errors, read_npz_arrays, require_file

MAX_TEXT_BYTES = 4 * 2**20      # 64 for each number of the longest IRF
TEXT_SUFFIXES = (".csv", ".txt", ".dat", ".asc")
SUFFIXES = (".npy", ".npz", ".mat", *TEXT_SUFFIXES, *tcspc_files.READERS)
MAX_STEPS = 2**20               # of a file whose steps become bins
UNITS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "ps": 1e-12, "fs": 1e-15}
UNIT = re.compile(rf"(?<![a-zµ])({'|'.join(UNITS_S)})(?![a-z])")
STEP = re.compile(rf"({'|'.join(UNITS_S)})\s*(?:/|per)\s*(?:bin|ch)\w*\W*?([\d.]+(?:e[-+]?\d+)?)")     # of PicoQuant
LEAST_STEP_S, MOST_STEP_S = 1e-18, 1.0
LIKELY_UNITS_S = 1.0, 1e-9, 1e-12       # of a time column whose header has none
WIDTH_TOLERANCE = 0.01          # of a bin: times are rounded, and an IRF of 50 bins is then half a bin too long
LEAST_KEPT = 0.9                # of the photons of an IRF that is cut to a period
MAT_VECTOR = re.compile(r"(\w+) \((?!1×1 )(?:1×\d+|\d+×1) (?:double|single|u?int\d+)\)")


class Steps(NamedTuple):
    """The time steps of an IRF's file."""

    name: str = ""                  # of the file
    text: str = ""                  # a step as the file has it
    widths_s: tuple[float, ...] = ()        # seconds that it may be; none if it is taken to be a bin
    notes: tuple[str, ...] = ()


def read(source: str | Path | np.ndarray | list) -> tuple[np.ndarray, Steps]:
    """The IRF, float64 [L] or [pixels, L], and the steps of its file.

    Files are .npy, .npz with `irf`, .mat with `irf` or a single vector, text with one number a line, or time and IRF,
    below lines of text, and .sdt, .phu and .ptu, whose brightest data set is taken, all pixels added up.
    """
    values, steps = _read_file(Path(source)) if isinstance(source, (str, Path)) else (source, Steps())
    irf = array("irf", values).astype(np.float64)
    irf = irf.squeeze() if irf.ndim == 2 and 1 in irf.shape else irf
    require(irf.ndim in (1, 2) and 0 < irf.shape[-1] <= (MAX_STEPS if steps.name else MAX_BINS), "irf shape", irf.shape,
            f"[L] or [pixels, L], L from 1 to {MAX_BINS}; irf_sigma_bins makes a Gaussian")
    for width_s in steps.widths_s:
        require(LEAST_STEP_S <= width_s <= MOST_STEP_S, "irf",
                problem=f"{steps.name}: a time step of {steps.text} is not possible.")
    return irf, steps


def fitted(irf: np.ndarray, ref: int | None, steps: Steps, sensor: SensorModel, width_known: bool
           ) -> tuple[np.ndarray, int | None, tuple[str, ...]]:
    """An IRF and its irf_ref in the sensor's bins, no longer than its period, and notes on what was changed.

    Raises:
        InvalidInput: the bin width is needed and not known, or a period holds too little of the IRF.
    """
    notes = steps.notes
    require(irf.ndim in (1, 2) and irf.size > 0, "irf shape", irf.shape, "[L] or [pixels, L]")
    if irf.ndim == 2:
        return irf, ref, notes
    ref = int(np.argmax(irf)) if ref is None else ref
    require(0 <= ref < len(irf), "irf_ref", ref, f"an index into the IRF, 0 … {len(irf) - 1}")
    if steps.widths_s:
        width_s = min(steps.widths_s, key=lambda one: abs(math.log(one / sensor.bin_width_s)))
        if not math.isclose(width_s, sensor.bin_width_s, rel_tol=WIDTH_TOLERANCE):
            require(width_known, "bin_width_s", problem=f"{steps.name} has an entry every {steps.text}: give "
                    "bin_width_s (--bin-width-s), to resample the IRF.")
            irf, ref = resampled(irf, ref, width_s / sensor.bin_width_s, steps)
            notes += Note(f"IRF resampled from steps of {width_s * 1e12:.6g} ps to bins of "
                          f"{sensor.bin_width_s * 1e12:.6g} ps ({steps.name})", "irf"),
    length, most = len(irf), sensor.num_bins
    if length > most:
        edge = max(length // 8, 1)
        below = np.concatenate([[0], np.cumsum(irf - min(irf[:edge].mean(), irf[-edge:].mean()))])
        inside = below[most:] - below[:-most]
        first = 0 if inside[0] >= LEAST_KEPT * inside.max() else int(inside.argmax())
        first = min(max(first, ref - most + 1), ref)
        kept = inside[first] / below[-1]
        require(kept >= LEAST_KEPT, "irf length", length,
                f"at most num_bins = {most}: a period would hold {kept:.0%} of it")
        irf, ref = irf[first:first + most], ref - first
        notes += Note(f"IRF cut from {length} bins to the {most} of a laser period", "irf"),
    return irf, ref, notes


def resampled(irf: np.ndarray, ref: int, ratio: float, steps: Steps) -> tuple[np.ndarray, int]:
    """An IRF in bins, of which a step has `ratio`, and its irf_ref.

    The centre of that bin is the centre of the step `ref`; but the step 0 begins where the bin 0 does, as on one axis.
    """
    part = 0.5 if ref else 0.0
    at = ref + part
    before, after = math.ceil(at * ratio - part), math.ceil((len(irf) - at) * ratio + part) - 1
    require(before + after < MAX_STEPS, "irf", problem=f"{steps.name} has an entry every {steps.text}, which is "
            f"{ratio:.3g} bins: correct bin_width_s, or the unit in the file.")
    edges = at + (np.arange(-before, after + 2) - part) / ratio
    below = np.interp(edges, np.arange(len(irf) + 1), np.concatenate([[0], np.cumsum(irf)]))
    return np.diff(below), before


def _read_file(path: Path) -> tuple[np.ndarray, Steps]:
    suffix = path.suffix.lower()
    require(suffix in SUFFIXES, "irf", str(path), f"a file that ends in {', '.join(SUFFIXES)}")
    require_file(path, "irf")
    if suffix == ".npy":
        return map_npy(path, f"irf file {path.name}"), Steps()
    if suffix == ".mat":
        return _read_mat(path), Steps()
    if suffix in TEXT_SUFFIXES:
        size = path.stat().st_size
        require(size <= MAX_TEXT_BYTES, f"irf file {path.name}", f"{size} bytes",
                f"at most {MAX_TEXT_BYTES} bytes of text")
        with read_errors(path, "numbers, in one column, or two: time and IRF"):
            return _read_text(path)
    if suffix == ".npz":
        arrays, _ = read_npz_arrays(path, ("irf", "bin_width_s"), "irf")
        require("irf" in arrays, "irf", problem=f"{path.name} has no array irf.")
        irf, notes = arrays["irf"], ()
        widths = [finite(f"{path.name} bin_width_s", one) for one in arrays.get("bin_width_s", np.zeros(0)).flat]
    else:
        sets = tcspc_files.READERS[suffix](path)
        chosen, _ = channel_of(tcspc_files.photons(sets), None)
        counts, width_s, _ = sets[chosen]
        irf, widths = counts.reshape(-1, counts.shape[-1]).sum(axis=0, dtype=np.float64), [width_s] * (width_s > 0)
        note = Note(f"IRF: data set {chosen} of {len(sets)} in {path.name}, all pixels added up", "irf")
        notes = (note,) if len(sets) > 1 or irf.size < counts.size else ()
    return irf, Steps(path.name, f"{widths[0] * 1e12:.6g} ps" if widths else "", (*widths,), notes)


def _read_mat(path: Path) -> np.ndarray:
    """The variable `irf`, or else the only vector."""
    found, listed = isolated.matlab_arrays(path, ("irf",))
    if "irf" in found:
        return found["irf"]
    vectors = MAT_VECTOR.findall(listed)
    require(len(vectors) == 1, "irf",
            problem=f"{path.name}: The file needs a variable irf or one vector. It has {listed}.")
    return isolated.matlab_arrays(path, tuple(vectors))[0][vectors[0]]


def _read_text(path: Path) -> tuple[np.ndarray, Steps]:
    """The numbers of the longest run of lines with numbers, and the time step, of a first column or of the header."""
    lines = [line for line in path.read_text(encoding="utf-8-sig", errors="replace").splitlines() if line.strip()]
    rows = [_numbers(line) for line in lines]
    runs = [list(run) for is_numbers, run in groupby(range(len(rows)), lambda line: bool(rows[line])) if is_numbers]
    require(len(runs) > 0, "", problem="The file has no numbers.")
    longest = max(runs, key=len)
    widths = {len(rows[line]) for line in longest}
    require(len(widths) == 1, "lines", f"of {min(widths)} to {max(widths)} numbers", "the same number in each")
    values, header = np.array([rows[line] for line in longest]), lines[:longest[0]]
    stated = STEP.search("\n".join(header).lower())
    if stated:          # one curve or more
        return values[:, values.sum(axis=0).argmax()], Steps(
            path.name, f"{stated[2]} {stated[1]}", (float(stated[2]) * UNITS_S[stated[1]],))
    if values.shape[1] < 2 or len(values) < 2:
        return values.reshape(-1) if 1 in values.shape else values, Steps()
    time = values[:, 0]
    step = (time[-1] - time[0]) / (len(time) - 1)
    even = step > 0 and np.abs(time - time[0] - step * np.arange(len(time))) <= step / 2       # they may be rounded
    if not np.all(even):
        require(values.shape[1] > 2, "irf", problem="The first of two columns must be an even time axis.")
        return values, Steps()
    names = re.split(r"[;\t,]", header[-1].lower()) if header else [""]
    named = next((column for column, name in enumerate(names[:values.shape[1]]) if "irf" in name), 0)
    irf = values[:, named or 1 + values[:, 1:].sum(axis=0).argmax()]
    unit = UNIT.search(names[0])
    if unit is None and math.isclose(step, 1):
        note = Note(f"{path.name}: the first column, in steps of 1, taken to count bins: if these are times, write "
                    "their unit above", "irf")
        return irf, Steps() if re.search("bin|ch|index", names[0]) else Steps(path.name, "1", (), (note,))
    likely = [step * unit_s for unit_s in LIKELY_UNITS_S if LEAST_STEP_S <= step * unit_s <= MOST_STEP_S] or [step]
    return irf, Steps(path.name, f"{step:g} {unit[1] if unit else ''}".rstrip(),
                      (step * UNITS_S[unit[1]],) if unit else tuple(likely))


def _numbers(line: str) -> list[float]:
    """The numbers of a line, before any comment; none if it has anything else. Beside ; or tab, a comma is decimal."""
    text = line.partition("#")[0].replace('"', "").strip()
    separator = next((one for one in (";", "\t", ",") if one in text), None)
    if separator in (";", "\t"):
        text = text.replace(",", ".")
    try:
        return [float(cell) for cell in text.rstrip(f"{separator or ''} ").split(separator)]
    except ValueError:
        return []
