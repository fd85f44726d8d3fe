# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bench samples from recorded bags (rosbag2): read, aligned in time, cut to steady windows."""

from hmcvt_tools import Steadiness

from .files import BAG_FILES
from .importing import Imported, ImportReport, import_bag, read_bag
from .settings import ImportSettings

__all__ = [
    "BAG_FILES",
    "ImportReport",
    "ImportSettings",
    "Imported",
    "Steadiness",
    "import_bag",
    "read_bag",
]
