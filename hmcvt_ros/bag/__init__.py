# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bench samples from recorded bags (rosbag2): read, aligned in time, cut to steady windows.

importing  from a bag to bench samples, and what became of its messages (`settings`)
files      which files a bag has, and what damages them
reader     its messages, one by one
topics     which topics hold the readings; `stages` the stage engaged
recording  the messages as time series on one clock
"""

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
