# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""ROS 2 node that serves the efficiency of a hydromechanical CVT; computes with `hmcvt_core`."""
