"""What all tests share: ROS 2 kept to this machine and to a domain of its own, and the photon data if present."""

import os
import random
from pathlib import Path

import pytest

# Before anything imports rclpy; the nodes that tests start inherit it.
os.environ["ROS_DOMAIN_ID"] = str(random.SystemRandom().randint(1, 100))
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["RERUN_TELEMETRY"] = "0"

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the source tree."""
    return REPOSITORY


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of photon data beside the repository; skips the test where there is none."""
    folder = REPOSITORY.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no photon data: the folder shared/data beside the repository is absent")
    return folder
