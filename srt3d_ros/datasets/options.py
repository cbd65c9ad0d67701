"""What the user says about a photon file: options, or a sidecar file beside it."""

from pathlib import Path

import numpy as np

from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import MAX_BINS, SensorModel
from srt3d_ros.datasets import irf as irfs
from srt3d_ros.errors import InvalidInput, quoted, require
from srt3d_ros.messages import json_text

NAMES = ("num_bins", "bin_width_s", "irf", "irf_ref", "toa_offset_bins", "range_offset_m", "toa_reference", "gate",
         "fov_deg", "rows", "cols")
MAX_SIDECAR_BYTES = 16 * 2**20
MAX_GATE_BIN = 2**31


def gather(path: Path, overrides: dict) -> dict:
    """The options of a photon file: the sidecar's (FILE.json, "head.mat.json" for head.mat), then `overrides` on top.

    An `irf` becomes an array here, one in the sidecar read relative to the sidecar's folder; a `gate` becomes two
    integers. An override of None counts as not given.

    Raises:
        InvalidInput: an unknown name, a broken sidecar, an IRF or a gate that cannot be used.
    """
    sidecar = path.with_name(path.name + ".json")
    options = _read_sidecar(sidecar) if sidecar.exists() else {}
    _check_names(options, sidecar.name)
    given = {name: value for name, value in overrides.items() if value is not None}
    _check_names(given, "option")
    if "irf" in given:
        given["irf"] = irfs.read(given["irf"])
        options.pop("irf_ref", None)                # it belongs to the IRF that is replaced
    elif "irf" in options:
        options["irf"] = irfs.read(options["irf"], path.parent)
    options |= given
    if "gate" in options:
        options["gate"] = _gate(options["gate"])
    return options


def apply_to(sensor: SensorModel, options: dict) -> SensorModel:
    """The sensor with the options in place of its own values; `gate`, `rows` and `cols` are not its concern."""
    names = ("num_bins", "bin_width_s", "toa_offset_bins", "range_offset_m", "toa_reference", "irf_ref")
    changes = {name: options[name] for name in names if name in options}
    if "irf" in options:
        changes |= {"irf": options["irf"], "irf_ref": options.get("irf_ref")}
    if "fov_deg" in options:
        changes["projection"] = pinhole(sensor.rows, sensor.cols, options["fov_deg"])
    return sensor.replace(**changes) if changes else sensor


def pinhole(rows: int, cols: int, fov_deg: object) -> Pinhole:
    """A pinhole with `fov_deg` across the larger side."""
    return Pinhole.from_fov(rows, cols, number("fov_deg", fov_deg, "an angle between 0 and 180 degrees"))


def number(field: str, value: object, expected: str) -> float:
    """`value` as a finite float, or InvalidInput."""
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(field, quoted(value), expected) from None
    require(np.isfinite(result), field, quoted(value), expected)
    return result


def _read_sidecar(path: Path) -> dict:
    try:
        size = path.stat().st_size
        require(size <= MAX_SIDECAR_BYTES, f"{path.name} size", size, f"at most {MAX_SIDECAR_BYTES} bytes")
        return json_text.parse(path.read_text(encoding="utf-8"), path.name)
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInput(path.name, f"unreadable ({error})", "a JSON object of options") from None


def _check_names(options: dict, where: str) -> None:
    for name in options:
        require(name in NAMES, f"{where} name", quoted(name), f"one of {', '.join(NAMES)}")


def _gate(value: object) -> tuple[int, int]:
    expected = f"two integers: first bin, and number of bins from 2 to {MAX_BINS}"
    try:
        first, bins = (number("gate", part, expected) for part in value)
    except (TypeError, ValueError) as error:
        raise error if isinstance(error, InvalidInput) else InvalidInput("gate", quoted(value), expected) from None
    valid = first == int(first) and bins == int(bins) and 0 <= first <= MAX_GATE_BIN and 2 <= bins <= MAX_BINS
    require(valid, "gate", quoted(value), expected)
    return int(first), int(bins)
