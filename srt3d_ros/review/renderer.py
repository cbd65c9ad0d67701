"""Draw recorded clouds: by the rerun viewer where it can run, else by our own renderer."""

from collections.abc import Sequence

import numpy as np

from srt3d_ros.core.projection import Projection
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.pictures.cloud_renderer import BACKGROUND, CloudStyle
from srt3d_ros.recording import screenshot
from srt3d_ros.recording.reader import RecordedCloud
from srt3d_ros.viewpoint import Viewpoint, look_at

_OWN_FOV_DEG = 30


class Renderer:
    """Draws clouds from one viewpoint.

    Args:
        kind: "viewer", "own", or "auto": the viewer if possible, else own.
        framed: the cloud that fills the pictures.
        style: colours and radius of the points.
        projection: the sensor's, which says where up is; or None.
        width, height: of the pictures.

    Raises:
        InvalidInput: `kind` is "viewer", which cannot run here.
    """

    def __init__(self, kind: str, framed: RecordedCloud, style: CloudStyle, projection: Projection | None, width: int,
                 height: int):
        possible = screenshot.is_possible()
        require(possible or kind != "viewer", "pictures", kind, f"Vulkan, which the viewer needs: {screenshot.INSTALL}")
        self._may_fall_back, self.style, self.width, self.height = kind == "auto", style, width, height
        self._framed, self._projection = framed, projection
        self.by_viewer = possible and kind != "own"

    @property
    def eye(self) -> Viewpoint:
        """The viewpoint of the pictures; it depends on who draws, so read it after `draw`."""
        fov_deg = screenshot.FOV_DEG if self.by_viewer else _OWN_FOV_DEG
        return look_at(self._framed.xyz, self._projection, fov_deg=fov_deg, aspect=self.width / self.height)

    def draw(self, clouds: Sequence[RecordedCloud]) -> list[np.ndarray]:
        """Draw the clouds; uint8 [height, width, 3] each.

        Raises:
            InvalidInput: `kind` is "viewer", and the viewer failed.
        """
        if self.by_viewer:
            try:
                return screenshot.screenshots([(cloud.xyz, self.style.shaded(cloud)) for cloud in clouds],
                                              self.style.radius_m, self.eye, self.width, self.height, BACKGROUND)
            except screenshot.ScreenshotError as error:
                if not self._may_fall_back:
                    raise InvalidInput("pictures", "viewer", f"a viewer that draws ({error})") from None
                self.by_viewer = False
        eye = self.eye
        return [self.style.draw(cloud, eye, self.width, self.height) for cloud in clouds]
