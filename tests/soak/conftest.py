# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The endurance trial, shortened; over real ROS, and left out with HMCVT_CORE_ONLY=1 only."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

if os.environ.get("HMCVT_CORE_ONLY") == "1":
    collect_ignore_glob = ["test_*.py"]
else:
    os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 101)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[object]:
    folder = tmp_path_factory.mktemp("soak")
    os.environ.setdefault("ROS_LOG_DIR", str(folder / "log"))
    yield folder
