"""The sensor that a file describes, for drivers that publish photons and nothing else."""

from pathlib import Path

from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets import open_photons
from srt3d_ros.datasets.files import require_file
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.messages import json_text, sensor


def open_sensor(path: str | Path) -> SensorModel:
    """The sensor in a .json file, as on the `sensor` topic (config/sensors/ has some), or that of a photon file.

    Args:
        path: .json, or anything that `open_photons` opens, with its sidecar.

    Raises:
        InvalidInput: one line that names the file and field that cannot be used.
    """
    path = Path(path)
    if path.suffix.lower() != ".json":
        return open_photons(path).sensor
    require_file(path, "sensor file")
    size = path.stat().st_size
    require(size <= json_text.MAX_BYTES, path.name, f"{size} bytes", f"at most {json_text.MAX_BYTES} bytes")
    try:
        return sensor.from_json(path.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError as error:
        raise InvalidInput(path.name, f"unreadable ({error})", "JSON in UTF-8") from None
    except InvalidInput as error:
        raise InvalidInput(f"{path.name} {error.field}", error.value, error.expected) from None
