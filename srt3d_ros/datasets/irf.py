"""Instrument responses: drawn by a formula or read from a file."""

import warnings
from pathlib import Path

import numpy as np

from srt3d_ros.datasets.files import map_npy, read_npz_arrays, require_file
from srt3d_ros.errors import InvalidInput, require

MAX_LENGTH = 65_535
MAX_TEXT_BYTES = 4 * 2**20      # 64 for each number of the longest response
TEXT_SUFFIXES = (".csv", ".txt")
SUFFIXES = (".npy", ".npz", *TEXT_SUFFIXES)


def spad(bin_width_s: float, fwhm_s: float = 55e-12, tail_s: float = 100e-12, tail_share: float = 0.3) -> np.ndarray:
    """The response of a SPAD: a Gaussian, some of it (`tail_share`) delayed by an exponential diffusion tail.

    Args:
        bin_width_s, fwhm_s, tail_s: seconds; `fwhm_s` is the Gaussian's (laser, jitter), `tail_s` the tail's 1/e time.

    Returns:
        float32 [L], sum 1, cut where it falls below 10⁻⁴ of its peak.
    """
    fine = 8                                            # steps a bin, so that narrow responses are integrated well
    step_s = bin_width_s / fine
    sigma_s = fwhm_s / np.sqrt(8 * np.log(2))
    lead = int(np.ceil(5 * sigma_s / bin_width_s)) * fine
    time_s = np.arange(-lead, int(np.ceil((5 * sigma_s + 12 * tail_s) / bin_width_s)) * fine) * step_s
    gauss = np.exp(-0.5 * (time_s / sigma_s) ** 2)
    decay = np.exp(-np.arange(len(time_s)) * step_s / tail_s)
    tail = np.convolve(gauss, decay / decay.sum())[: len(time_s)]
    bins = ((1 - tail_share) * gauss + tail_share * tail).reshape(-1, fine).sum(axis=1)
    seen = np.flatnonzero(bins > 1e-4 * bins.max())
    bins = bins[seen[0]: seen[-1] + 1]
    return (bins / bins.sum()).astype(np.float32)


def read(source: str | Path | np.ndarray | list, folder: Path | None = None) -> np.ndarray:
    """An IRF given as an array or list, or as the path of a file; float64 [L] or [pixels, L], not yet normalised.

    A file is .npy, .npz (its array `irf`, its only array, or the one named in "FILE.npz:NAME"), or .csv or .txt with
    one number to a line. Paths are relative to `folder`.

    Raises:
        InvalidInput: the file or its content cannot be used.
    """
    if isinstance(source, (str, Path)):
        text, key = str(source), None
        if ".npz:" in text:
            text, key = text.rsplit(":", 1)
        path = (folder or Path()) / text
        require(path.suffix.lower() in SUFFIXES, "irf", text, f"a file {', '.join(SUFFIXES)}")
        require_file(path, "irf")
        values = _read_file(path, key)
    else:
        values = source
    try:
        irf = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput("irf", source, "numbers") from None
    irf = irf.squeeze() if irf.ndim == 2 and 1 in irf.shape else irf
    require(irf.ndim in (1, 2) and 0 < irf.shape[-1] <= MAX_LENGTH, "irf shape", irf.shape,
            f"[L] or [pixels, L], L from 1 to {MAX_LENGTH}")
    return irf


def _read_file(path: Path, key: str | None) -> np.ndarray:
    if path.suffix.lower() == ".npz":
        arrays = read_npz_arrays(path, None if key is None else (key,))
        if key is None and "irf" not in arrays:
            numeric = [name for name, array in arrays.items() if array.dtype.kind in "iuf" and array.ndim]
            require(len(numeric) == 1, f"{path.name} arrays", ", ".join(arrays), "one named irf, or FILE.npz:NAME")
            key = numeric[0]
        require((key or "irf") in arrays, f"{path.name} array", key, f"one of {', '.join(arrays)}")
        return arrays[key or "irf"]
    if path.suffix.lower() == ".npy":
        return map_npy(path, f"irf file {path.name}")
    require(path.stat().st_size <= MAX_TEXT_BYTES, f"irf file {path.name}", f"{path.stat().st_size} bytes",
            f"at most {MAX_TEXT_BYTES} bytes of text")
    try:
        with warnings.catch_warnings():     # of a file without numbers, which the caller refuses
            warnings.simplefilter("ignore")
            return np.loadtxt(path, delimiter="," if path.suffix.lower() == ".csv" else None, ndmin=1)
    except (OSError, ValueError, EOFError) as error:
        raise InvalidInput(f"irf file {path.name}", str(error), "numbers") from None
