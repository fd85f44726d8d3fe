# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the node has loaded once it serves: nothing that only refits, plots or commands need."""

import json
import subprocess
import sys

import pytest

START = """
import json, sys
import rclpy
from hmcvt_ros.node import EfficiencyNode
rclpy.init(args=["--ros-args", "-p", "state_folder:=" + sys.argv[1]])
node = EfficiencyNode()
print(json.dumps(sorted(sys.modules)))
node.close()
node.destroy_node()
rclpy.shutdown()
"""


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    done = subprocess.run(
        [sys.executable, "-c", START, str(tmp_path_factory.mktemp("state"))],
        capture_output=True, text=True, check=True, timeout=60)
    return set(json.loads(done.stdout))


def test_node_does_without(loaded):
    assert "hmcvt_core.physics.steady_state" in loaded
    assert not loaded & {"scipy.optimize", "scipy.stats", "scipy.interpolate", "matplotlib",
                         "pymoo", "distributed", "rosbags", "click"}


def test_worker_is_given_nothing_of_ros(tmp_path):
    """It is given the main module of the node, and at full priority."""
    code = ("import hmcvt_ros.efficiency_node, hmcvt_ros.worker, sys\n"
            "print(*sys.modules)")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                          timeout=60)
    assert not {"rclpy", "numpy", "hmcvt_core"} & set(done.stdout.split())
