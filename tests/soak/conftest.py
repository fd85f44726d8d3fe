# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The endurance trial, shortened; over real ROS, and left out with HMCVT_CORE_ONLY=1 only."""

import os

if os.environ.get("HMCVT_CORE_ONLY") == "1":
    collect_ignore_glob = ["test_*.py"]
# Read by the message classes when they are made: a field of the wrong type then raises.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
