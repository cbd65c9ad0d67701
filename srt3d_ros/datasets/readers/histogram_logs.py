"""JSON logs of sensors that send histograms (ams TMF8829, TMF882x), plain or packed by gzip, frame by frame."""

import gzip
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from srt3d_ros.datasets.files import naming_file, require_file
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.datasets.readers import tmf882x, tmf8829
from srt3d_ros.errors import require

MAX_LOG_BYTES = 2**28       # of text, unpacked: a parsed log takes some five times as much
EXPECTED = "a log of a TMF8829 (an object with Result_Set) or TMF882x (a list of captures)"


def frames(path: Path, options: dict) -> Iterator[Photons]:
    """The frames of a log, with these options (options.gathered) in place of what it says.

    Raises:
        InvalidInput: no whole log, or at the frame that is broken.
    """
    require_file(path, "log")
    with naming_file(path, "a whole log in JSON"), (gzip.open if path.suffix == ".gz" else open)(path, "rb") as stream:
        text = stream.read(MAX_LOG_BYTES + 1)
        require(len(text) <= MAX_LOG_BYTES, "size", f"more than {MAX_LOG_BYTES} bytes", "a shorter log: split it")
        log = json.loads(text.decode("utf-8-sig"))
    reader = tmf882x if isinstance(log, list) else tmf8829
    require(reader is tmf882x or isinstance(log, dict) and "Result_Set" in log, path.name, type(log).__name__, EXPECTED)
    for photons in reader.frames(log, path.name):
        yield replace(photons, name=path.stem).with_options(options)
