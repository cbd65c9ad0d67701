"""What `srt3d reconstruct` is asked to do with a frame: from its photons, or their sketch, to the cloud to be saved."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from srt3d_ros import api
from srt3d_ros.core.method.background import dark_shape
from srt3d_ros.core.methods import find
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.errors import require
from srt3d_ros.results import Cloud, Sketch


@dataclass(frozen=True)
class Request:
    """What to reconstruct, and how; every frame by itself, so that no cloud depends on which were done before.

    Args:
        input: photon file, bag or log.
        photons_topic: of a bag that has several.
        overrides: what the input does not say: options of `srt3d_ros.read`.
        options: of `srt3d_ros.reconstruct`.
        dark: photon file recorded without the laser's echo, or None.
        surface_order: which of a pixel's surfaces comes first.
    """

    input: Path
    photons_topic: str
    overrides: dict[str, Any]
    options: dict[str, Any]
    dark: str | None
    surface_order: str

    def cloud(self, seen: Photons | Sketch) -> Cloud:
        """The cloud of a frame that `srt3d_ros.read` gave; InvalidInput for options that do not suit it."""
        if self.dark is not None:
            require(isinstance(seen, Photons), "dark", self.dark, "nothing: the bag has sketches, made without it")
            seen = seen.with_options({"background_shape": self._background_shape(seen.sensor)})
        return api.reconstruct(seen, **self.options).ordered(self.surface_order)

    def _background_shape(self, sensor: SensorModel) -> np.ndarray:
        """How the background spreads in the dark frame that a sensor recorded."""
        method = find(self.options["method"])
        require("background" in method.options, "dark", self.dark, f"nothing: {method.name} has no use for it")
        background = self.options.get("background")
        require(background != "flat", "background", background, "auto or sensor, with a dark frame")
        known = {"irf": sensor.irf, "irf_ref": sensor.irf_ref, "bin_width_s": sensor.bin_width_s}
        dark = api.read(self.dark, **(known | self.overrides))
        for name in ("rows", "cols", "num_bins"):
            found, wanted = getattr(dark.sensor, name), getattr(sensor, name)
            require(found == wanted, f"dark frame {name}", found, f"{wanted}, as in the input")
        return dark_shape(dark.frame, sensor)
