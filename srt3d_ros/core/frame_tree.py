"""FrameTree: fixed frames of a robot, and where one lies in another."""

from srt3d_ros.core.motion import Pose


class FrameTree:
    """Poses of frames in their parents', as /tf_static says them; the last one of each frame counts."""

    def __init__(self) -> None:
        self._above: dict[str, tuple[str, Pose]] = {}

    def add(self, parent: str, child: str, pose: Pose) -> None:
        """The pose of `child` in `parent`."""
        self._above[child.lstrip("/")] = parent.lstrip("/"), pose

    def pose(self, frame: str, of: str) -> Pose | None:
        """The pose of a frame in the frame `of`; None if nothing connects them."""
        here, there = self._chain(frame), self._chain(of)
        common = next((name for name in here if name in there), None)
        return None if common is None else there[common].inverse() @ here[common]

    def _chain(self, frame: str) -> dict[str, Pose]:
        """The frame and those above it, nearest first, each with the pose of the frame in it."""
        name = frame.lstrip("/")
        chain = {name: Pose()}
        while name in self._above and self._above[name][0] not in chain:       # which a circle would be
            parent, pose = self._above[name]
            chain[parent] = pose @ chain[name]
            name = parent
        return chain
