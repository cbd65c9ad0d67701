"""Shared by all tests: ROS 2 on this machine alone, in a domain of its own, and the photon data if present."""

import os
import resource
import signal
import threading
from pathlib import Path

import pytest

from srt3d_ros.processes.private_network import claim_domain

# Set before anything imports rclpy, and inherited by nodes. Each worker of pytest-xdist claims another domain.
os.environ["ROS_DOMAIN_ID"] = str(claim_domain())
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["RERUN_TELEMETRY"] = "0"

# Tests end programs with SIGINT, which a shell ignores in what it starts in the background.
if threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)

MAX_WORKERS = 4
# These start first, so that none keeps a single worker busy at the end. Files that wait alternate with files that
# compute.
LONG = ("tests/test_demo.py", "tests/kernels/test_device.py", "tests/docs/test_commands.py",
        "tests/kernels/test_compiling.py", "tests/processes/test_supervisor.py", "tests/test_install.py",
        "tests/nodes/test_two_machines.py", "tests/core/test_same_bits.py", "tests/robustness/test_pipeline.py",
        "tests/cli/test_frames.py", "tests/nodes/test_recorder.py", "tests/core/test_quality.py")
REPOSITORY = Path(__file__).resolve().parent.parent


def pytest_addoption(parser):
    parser.addoption("--rounds", type=int, default=50, help="damaged inputs a reader in tests/robustness; 50")


def pytest_xdist_auto_num_workers(config) -> int:
    """One more worker than processors: tests of nodes wait for a fifth of their time."""
    return min(len(os.sched_getaffinity(0)) + 1, MAX_WORKERS)


def pytest_collection_modifyitems(items):
    """Sort long files first. pytest-xdist keeps this order (--no-loadscope-reorder)."""
    first = [REPOSITORY / path for path in LONG]
    assert all(path.exists() for path in first)
    items.sort(key=lambda item: first.index(item.path) if item.path in first else len(first))


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the source tree."""
    return REPOSITORY


@pytest.fixture(scope="session")
def ros():
    """Initialise rclpy once for all tests of a process."""
    import rclpy

    from srt3d_ros.processes import transport

    transport.prepare_process()
    rclpy.init()
    yield
    rclpy.try_shutdown()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of photon data beside the repository; skips the test where there is none."""
    folder = REPOSITORY.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no photon data: the folder shared/data beside the repository is absent")
    return folder


@pytest.fixture
def full_disk():
    """Limit every file to 1000 bytes, as a full disk would; the error is "File too large"."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture(scope="session")
def ball():
    """A cloud and its sensor: a ball before a wall seen by 40 × 48 pixels, two surfaces at its rim, a hole."""
    import numpy as np

    from srt3d_ros.cloud import Cloud
    from srt3d_ros.core.sensor.model import SensorModel

    sensor = SensorModel(40, 48, 600, 20e-12, np.hanning(12)[1:], toa_offset_bins=100, frame_id="test_lidar")
    y, x = np.mgrid[-1:1:40j, -1.2:1.2:48j]
    radius = np.hypot(x, y)
    seen = (radius > 0.1) & (radius < 0.8)
    front = np.where(seen, 300 - 120 * np.sqrt(np.maximum(0.64 - radius**2, 0)), 450)
    front[:3, :4] = np.nan
    layers = np.stack([front, np.where((radius > 0.7) & seen, 450, np.nan)])
    surface, row, col = np.nonzero(np.isfinite(layers))
    order = np.lexsort((surface, row * sensor.cols + col))
    surface, row, col = surface[order].astype(np.uint8), row[order].astype(np.uint16), col[order].astype(np.uint16)
    depth = layers[surface, row, col].astype(np.float32)
    intensity = (20 + 15 * np.sin(x * 9) * np.cos(y * 9)).astype(np.float32)[row, col]
    cloud = Cloud(row, col, depth, intensity, (1 / np.sqrt(intensity)).astype(np.float32),
                  sensor.xyz(row, col, depth), surface, np.full((40, 48), 2.5, np.float32),
                  stamp_ns=1_234_567_890, sensor=sensor)
    return cloud, sensor


@pytest.fixture(scope="session")
def layers(tmp_path_factory) -> Path:
    """A photon file of 12 × 20 pixels and 300 bins: two layers, at bins 80 and 200, 60 photons a pixel, SBR 10."""
    import numpy as np

    from srt3d_ros.core.sensor.model import SensorModel
    from srt3d_ros.datasets import photon_file
    from srt3d_ros.datasets.simulation.scene import StaticScene
    from srt3d_ros.datasets.simulation.simulator import Simulator

    sensor = SensorModel(12, 20, 300, 5e-11, np.exp(-np.linspace(-2, 3, 21)**2), toa_offset_bins=1_000)
    scene = StaticScene(sensor.range_m(np.array([80.0, 200.0])[:, None, None] + np.zeros((12, 20))))
    path = tmp_path_factory.mktemp("photons") / "layers.npz"
    photon_file.save(path, sensor, *Simulator(scene, sensor, sbr=10, ppp=60).frame(0))
    return path
