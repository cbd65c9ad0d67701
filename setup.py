"""Install srt3d_ros with pip, colcon (build type ament_python) or `make demo`.

ROS is an extra. With ROS 2 from apt, rclpy and the messages come from apt (package.xml, rosdep), and pip must not add a
second copy: use `colcon build`, or `pip install .` in a virtual environment made with --system-site-packages. Elsewhere
`pip install '.[ros]'` brings ROS 2 Jazzy; '.[ros-kilted]', in another environment, brings Kilted. Only NVIDIA GPUs need
torch (extra `gpu`): its CUDA builds are gigabytes.
"""

import re
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = "srt3d_ros"
ROOT = Path(__file__).parent
VERSION = re.search(r'__version__ = "(.+)"', (ROOT / NAME / "__init__.py").read_text())[1]
URL = "https://github.com/srt3d-ros/srt3d_ros"
MAINTAINERS, EMAIL = "srt3d_ros maintainers", "maintainers@srt3d-ros.org"

# rerun-sdk needs NumPy 2. The core does not require it, because apt packages of Ubuntu 24.04 use NumPy 1.26.
RERUN = "rerun-sdk>=0.41,<0.42"
PICTURES = ["matplotlib>=3.8,<4", "Pillow>=10.2,<14"]
TORCH = "torch>=2.9,<3"
PYZMQ = "pyzmq>=25,<28"
# mcap reads what is left of a bag whose recording broke off.
BAGS = ["rosbags>=0.11.9,<0.12", "mcap>=1.2,<2"]
# ptufile and sdtfile change their interfaces every year.
LAB = ["ptufile>=2026.2,<2027", "sdtfile>=2026.2,<2027", "h5py>=3.10,<4"]
CLUSTER = ["distributed>=2025.1,<2027"]
# Sphinx makes the site, as for other ROS 2 packages; sphinx-mathjax-offline lets it be read without a network.
DOCS = ["sphinx>=7.2,<10", "myst-nb>=1.1,<2", "furo>=2024.5,<2027", "sphinx-copybutton>=0.5,<1",
        "sphinx-mathjax-offline>=0.0.2,<0.1"]
EXTRAS = {
    "ros": ["ros-jazzy-rclpy[fastrtps]>=7.1,<8", "ros-jazzy-common-interfaces>=5.3,<6",
            "ros-jazzy-rmw-fastrtps-cpp>=8.4,<9"],
    "ros-kilted": ["ros-kilted-rclpy[fastrtps]>=9.1,<10", "ros-kilted-common-interfaces>=5.5,<6",
                   "ros-kilted-rmw-fastrtps-cpp>=9.3,<10"],
    "pictures": [*PICTURES],
    "record": [RERUN],
    "review": [RERUN, *PICTURES, "Jinja2>=3.1,<4"],
    "bags": [*BAGS],
    "cluster": [*CLUSTER],
    "gpu": [TORCH],
    "docs": [*DOCS],
    "lab": [*LAB],
    "test": [*BAGS, *CLUSTER, PYZMQ, *LAB, *DOCS, "pytest>=8,<10", "pytest-xdist>=3.6,<4",
             "hypothesis>=6.100,<7", "psutil>=5.9,<8",
             "colcon-common-extensions>=0.3,<0.4", "ruff>=0.6,<0.18", TORCH],
}


def under(folder):
    """(destination in share/, files) of a top-level folder."""
    return f"share/{NAME}/{folder}", sorted(path for path in glob(f"{folder}/*") if Path(path).is_file())


setup(
    name=NAME,
    version=VERSION,
    description="Real-time 3D point clouds from single-photon lidar, as ROS 2 nodes and a library",
    long_description=(ROOT / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    keywords=["single-photon lidar", "SPAD", "point cloud", "3D reconstruction", "ROS 2", "SRT3D"],
    classifiers=["Development Status :: 4 - Beta", "Intended Audience :: Science/Research",
                 "Operating System :: POSIX :: Linux", "Topic :: Scientific/Engineering :: Image Processing",
                 *(f"Programming Language :: Python :: 3.{minor}" for minor in (11, 12, 13)), "Typing :: Typed"],
    url=URL,
    project_urls={"Documentation": f"{URL}/tree/main/docs", "Changelog": f"{URL}/blob/main/CHANGELOG.rst",
                  "Issues": f"{URL}/issues"},
    license="Apache-2.0",
    author=MAINTAINERS,
    author_email=EMAIL,
    maintainer=MAINTAINERS,
    maintainer_email=EMAIL,
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"], f"{NAME}.review": ["report.html"]},
    python_requires=">=3.11",
    install_requires=["numpy>=1.26,<3", "scipy>=1.11,<2", "numba>=0.60,<1", "tqdm>=4.66,<5", "jsonschema>=4.10,<5"],
    extras_require=EXTRAS,
    entry_points={"console_scripts": ["srt3d = srt3d_ros.cli.main:main"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        under("msg_schemas"),
        under("launch"),
        under("config"),
        under("config/sensors"),
        under("examples"),
        # `ros2 run` looks here. Console scripts would be on PATH under names like `player`.
        (f"lib/{NAME}", sorted(glob("scripts/nodes/*"))),
    ],
    zip_safe=False,
)
