"""What setuptools and colcon need beside pyproject.toml: version, licence, packages, and files that ROS 2 looks for."""

import re
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = "srt3d_ros"
VERSION = re.search(r'__version__ = "(.+)"', (Path(__file__).parent / NAME / "__init__.py").read_text())[1]


setup(
    version=VERSION,
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"], f"{NAME}.review": ["report.html"],
                  f"{NAME}.pictures": ["cloud_page.html"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *((f"share/{NAME}/{folder}", sorted(path for path in glob(f"{folder}/*") if Path(path).is_file()))
          for folder in ("msg_schemas", "launch", "config", "config/sensors", "examples")),
        # `ros2 run` looks here. Console scripts would be on PATH under names like `player`.
        (f"lib/{NAME}", sorted(glob("scripts/nodes/*"))),
    ],
    zip_safe=False,
)
