"""Reading files nobody vouches for: what they hold is known and bounded before any of it is loaded."""

import zipfile
import zlib
from pathlib import Path

import numpy as np

from srt3d_ros.errors import InvalidInput, require

MAX_ARRAY_BYTES = 2**32     # of one array in a file
MAX_MEMBERS = 1000


def require_file(path: Path, field: str) -> None:
    """Raise InvalidInput unless `path` is a file that can be opened."""
    require(path.is_file(), field, str(path), "a file that exists")
    try:
        path.open("rb").close()
    except OSError as error:
        raise InvalidInput(field, str(path), f"a file that can be read ({error.strerror})") from None


def read_npz_arrays(path: Path, names: tuple[str, ...] | None = None) -> dict[str, np.ndarray]:
    """Arrays of an .npz file, those of `names` that it has, or all; no pickles, sizes checked against the headers.

    Raises:
        InvalidInput: not a zip file, truncated, an array of objects, or one above MAX_ARRAY_BYTES.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = [info for info in archive.infolist() if info.filename.endswith(".npy")]
            require(len(members) <= MAX_MEMBERS, f"{path.name} members", len(members), f"at most {MAX_MEMBERS}")
            wanted = [info for info in members if names is None or info.filename[:-4] in names]
            return {info.filename[:-4]: _read_member(archive, info, path.name) for info in wanted}
    except (zipfile.BadZipFile, EOFError, OSError, NotImplementedError, RuntimeError, zlib.error) as error:
        raise InvalidInput(path.name, f"unreadable ({error})", "a complete .npz file (a zip of arrays)") from None


def _read_member(archive: zipfile.ZipFile, info: zipfile.ZipInfo, file_name: str) -> np.ndarray:
    field = f"{file_name} {info.filename[:-4]}"
    with archive.open(info) as stream:
        try:
            version = np.lib.format.read_magic(stream)
            read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
            shape, _, dtype = read_header[version](stream)
        except (ValueError, KeyError) as error:
            raise InvalidInput(field, f"unreadable ({error})", "an array as NumPy writes it") from None
        header_bytes = stream.tell()
    require(not dtype.hasobject, f"{field} dtype", str(dtype), "numbers or text, not Python objects")
    size = int(np.prod(shape, dtype=object)) * dtype.itemsize
    require(size <= MAX_ARRAY_BYTES, f"{field} size", f"{size} bytes", f"at most {MAX_ARRAY_BYTES} bytes")
    require(size == info.file_size - header_bytes, f"{field} size", f"{info.file_size - header_bytes} bytes",
            f"{size} bytes, as its header says")
    with archive.open(info) as stream:
        return np.lib.format.read_array(stream, allow_pickle=False)
