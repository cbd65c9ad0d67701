"""Who draws the clouds: the rerun viewer where it can run without a screen, or our own rasteriser."""

from collections.abc import Sequence

import numpy as np

from srt3d_ros.core.projection import Projection
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.pictures.look import BACKGROUND, Look
from srt3d_ros.recording import screenshot
from srt3d_ros.recording.reader import CloudFrame
from srt3d_ros.viewpoint import Viewpoint, look_at

KINDS = ("auto", "viewer", "own")
_OWN_FOV_DEG = 30


class Camera:
    """Draws clouds from one eye.

    Args:
        kind: "viewer", "own", or "auto": the viewer if it can, else own.
        framed: the cloud that fills the pictures.
        look: colours and size of points.
        projection: the sensor's, which says where up is; or None.
        width, height: of the pictures.

    Raises:
        InvalidInput: the viewer was asked for and cannot run here.
    """

    def __init__(self, kind: str, framed: CloudFrame, look: Look, projection: Projection | None, width: int,
                 height: int):
        require(kind in KINDS, "pictures", kind, ", ".join(KINDS))
        possible = screenshot.is_possible()
        require(possible or kind != "viewer", "pictures", kind, f"Vulkan, which the viewer needs: {screenshot.INSTALL}")
        self._may_fall_back, self.look, self.width, self.height = kind == "auto", look, width, height
        self._framed, self._projection = framed, projection
        self.by_viewer = possible and kind != "own"

    @property
    def eye(self) -> Viewpoint:
        """From where the pictures are drawn."""
        fov_deg = screenshot.FOV_DEG if self.by_viewer else _OWN_FOV_DEG
        return look_at(self._framed.xyz, self._projection, fov_deg=fov_deg, aspect=self.width / self.height)

    def draw(self, clouds: Sequence[CloudFrame]) -> list[np.ndarray]:
        """The clouds as `eye` sees them afterwards, uint8 [height, width, 3] each.

        Raises:
            InvalidInput: the viewer was asked for and did not draw.
        """
        if self.by_viewer:
            try:
                return screenshot.screenshots([(cloud.xyz, self.look.shaded(cloud)) for cloud in clouds],
                                              self.look.radius_m, self.eye, self.width, self.height, BACKGROUND)
            except screenshot.ScreenshotError as error:
                if not self._may_fall_back:
                    raise InvalidInput("pictures", "viewer", f"a viewer that draws ({error})") from None
                self.by_viewer = False
        eye = self.eye
        return [self.look.draw(cloud, eye, self.width, self.height) for cloud in clouds]
