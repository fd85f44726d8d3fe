# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What colcon has to find here; dependencies, extras and tools stand in pyproject.toml."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "hmcvt_ros"
ROOT = Path(__file__).parent
VERSION = re.search(
    r'__version__ = "([^"]+)"',
    (ROOT / "hmcvt_core" / "version.py").read_text(encoding="utf-8"),
).group(1)
# The folders data/ and params/ lie at the root for the reader and in the package for the user.
# `colcon build --symlink-install` links the packages alone to its build folder; the links lead back
# to the checkout, where hmcvt_core finds the two folders.
SHIPPED = {
    f"hmcvt_core.{name}": name for name in ("data", "params") if (ROOT / name).is_dir()
}

setup(
    name=NAME,
    version=VERSION,
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=[
        *find_packages(include=["hmcvt_core*", "hmcvt_tools*", "hmcvt_ros*"]),
        *SHIPPED,
    ],
    package_dir=SHIPPED,
    include_package_data=False,
    package_data={
        "hmcvt_core": ["py.typed"],
        "hmcvt_core.data": ["*.csv", "*.md"],
        "hmcvt_tools": ["py.typed"],
        "hmcvt_tools.export": ["templates/*"],
        "hmcvt_tools.report": ["templates/*.j2", "templates/*.mplstyle"],
        "hmcvt_core.params": ["*.yaml", "*.csv", "*.md"],
        "hmcvt_ros": [
            "py.typed",
            "config/*.yaml",
            "launch/*.launch.py",
            "security/*.xml",
        ],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", ["hmcvt_ros/resource/hmcvt_ros"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["hmcvt_ros/launch/hmcvt.launch.py"]),
        (f"share/{NAME}/config", ["hmcvt_ros/config/hmcvt.yaml"]),
        (f"share/{NAME}/security", ["hmcvt_ros/security/hmcvt.policy.xml"]),
    ],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "hmcvt = hmcvt_tools.cli:main",
            "hmcvt-node = hmcvt_ros.efficiency_node:main",
            # The name that `ros2 run hmcvt_ros efficiency_node` looks for.
            "efficiency_node = hmcvt_ros.efficiency_node:main",
        ],
        "hmcvt.commands": [
            "import-bag = hmcvt_ros.commands.import_bag:command",
            "node = hmcvt_ros.commands.node:command",
        ],
        "hmcvt.readers": [
            *(f"{kind} = hmcvt_ros.bag:read_bag" for kind in ("folder", "mcap", "db3")),
            *(
                f"{kind} = hmcvt_tools.logs.log_import:read_log"
                for kind in ("mf4", "mdf", "tdms", "blf", "asc", "trc", "log")
            ),
        ],
    },
)
