"""Draw clouds with the headless rerun viewer. Needs Vulkan, by a GPU or in software (Mesa's lavapipe).

rerun's API for this is experimental: no other module uses it.
"""

import ctypes.util
import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
import rerun_cli
from PIL import Image
from rerun.experimental import ViewerClient

from srt3d_ros.core.viewpoint import Viewpoint
from srt3d_ros.processes import wait_or_kill
from srt3d_ros.recording.blueprint import view_from

FOV_DEG = 55                    # of the viewer's eye, across the height of its view
INSTALL = "apt-get install mesa-vulkan-drivers libvulkan1"
_DRIVERS = ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d")
_VIEW = "cloud"
_START_TIMEOUT_S = 30.0
_STOP_TIMEOUT_S = 5.0
_MOST_SHOTS = 6                 # until two are equal: the first may come before everything is drawn
_ABOVE_PX = 100                 # height of the window above the view
_NOTES_PX = 400                 # width of an empty view on the right, where the viewer shows its notifications
_SPARE_PX = 16                  # width of the view's borders, cut off on both sides


class ScreenshotError(RuntimeError):
    """The viewer did not start, or did not draw."""


def is_possible() -> bool:
    """True if Vulkan is installed, so that the viewer can run."""
    return ctypes.util.find_library("vulkan") is not None and any(
        any(Path(folder).glob("*.json")) for folder in _DRIVERS)


def screenshots(clouds: Sequence[tuple[np.ndarray, np.ndarray]], radius_m: float, eye: Viewpoint, width: int,
                height: int) -> list[np.ndarray]:
    """Draw clouds with the viewer; returns uint8 [height, width, 3] each.

    Args:
        clouds: xyz float [N, 3] in metres and colours uint8 [N, 3] of each.
        radius_m: of the points.
        eye: with a fov_deg of FOV_DEG; the picture must be wider than high.
        width, height: of the pictures, pixels.

    Raises:
        ScreenshotError: if the viewer does not start or does not draw.
    """
    with tempfile.TemporaryDirectory(prefix="srt3d_") as folder:
        recording = Path(folder) / "clouds.rrd"
        wide = width + 2 * _SPARE_PX
        _record(recording, clouds, radius_m, eye, [wide, _NOTES_PX])
        with _viewer(wide + _NOTES_PX, height + _ABOVE_PX, Path(folder)) as viewer:
            try:
                viewer.open(str(recording))
                return [_fitted(_shot(viewer, k, Path(folder)), width, height) for k in range(len(clouds))]
            except (RuntimeError, OSError) as e:
                raise ScreenshotError(f"the viewer did not draw: {e}") from None


def _record(path: Path, clouds, radius_m: float, eye: Viewpoint, widths: list[int]) -> None:
    """Record the clouds as frames 0, 1, … with a blueprint of a 3D view and, on its right, an empty view."""
    notes = rrb.TextDocumentView(origin="/nothing", name=" ")
    views = rrb.Horizontal(view_from(eye, _VIEW), notes, column_shares=widths)
    stream = rr.RecordingStream("srt3d_ros_pictures")
    stream.save(path, default_blueprint=rrb.Blueprint(views, auto_views=False, auto_layout=False, collapse_panels=True))
    for k, (xyz, colour) in enumerate(clouds):
        stream.set_time("frame", sequence=k)
        stream.log("points", rr.Points3D(np.array(xyz, np.float32), colors=colour, radii=radius_m))
    stream.disconnect()


@contextmanager
def _viewer(width: int, height: int, folder: Path) -> Iterator[ViewerClient]:
    """Start a viewer on the loopback interface; stop it afterwards."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    # Not ViewerClient.spawn(), whose viewer listens on all interfaces.
    command = [str(Path(rerun_cli.__file__).with_name("rerun")), "--headless", "--bind", "127.0.0.1",
               "--port", str(port), "--window-size", f"{width}x{height}", "--hide-welcome-screen"]
    with open(folder / "viewer.log", "wb") as log:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                                   env=os.environ | {"RUST_LOG": "error", "XDG_RUNTIME_DIR": str(folder),
                                                     "TMPDIR": str(folder)})       # where it leaves files
    try:
        yield _connected(process, port, folder / "viewer.log")
    finally:
        process.terminate()
        wait_or_kill(process, _STOP_TIMEOUT_S)


def _connected(process: subprocess.Popen, port: int, log: Path) -> ViewerClient:
    deadline_s = time.monotonic() + _START_TIMEOUT_S
    while process.poll() is None and time.monotonic() < deadline_s:
        try:
            client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            client.get_state()
            return client
        except (RuntimeError, ConnectionError, OSError):
            time.sleep(0.1)
    last = log.read_text(errors="replace").strip().split("\n")[-1]
    raise ScreenshotError(f"the viewer did not start: {last}")


def _shot(viewer: ViewerClient, frame: int, folder: Path) -> Image.Image:
    """A screenshot of a frame, once two in a row are equal: everything is drawn."""
    viewer.set_time("frame", sequence=frame, play_state="paused")
    (view,) = (view for view in viewer.get_state().views if view.name == _VIEW)
    if view.reports:
        raise ScreenshotError(f"the viewer reports: {view.reports[0]}")
    before = None
    for _ in range(_MOST_SHOTS):
        viewer.save_screenshot(str(folder / "shot.png"), view_id=view.view_id)
        image = Image.open(folder / "shot.png").convert("RGB")
        if before is not None and image.tobytes() == before.tobytes():
            break
        before = image
    return image


def _fitted(image: Image.Image, width: int, height: int) -> np.ndarray:
    """The middle of a view in this size; the width of its borders varies between versions of the viewer."""
    scale = height / image.height
    image = image.resize((round(image.width * scale), height)) if scale != 1 else image
    left = (image.width - width) // 2
    return np.asarray(image.crop((left, 0, left + width, height)))
