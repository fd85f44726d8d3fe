# SPDX-License-Identifier: Apache-2.0
"""The shipped SROS2 policy, enforced by a DDS that has security.

The DDS of the ROS wheels has none, so the node itself cannot take part: participants with the
topics of the node and of its client stand in for them.
"""

from __future__ import annotations

import glob
import os
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from dds_security import Keystore, build, rules, settings

import hmcvt_ros

PLUGINS = sorted(glob.glob("/usr/lib/*/libddsc0debian"))
POLICY = Path(hmcvt_ros.__file__).parent / "security" / "hmcvt.policy.xml"
SECONDS = 6

pytestmark = pytest.mark.skipif(
    not (PLUGINS and all(map(shutil.which, ("idlc", "cc", "openssl")))),
    reason="needs Cyclone DDS with security: apt-get install cyclonedds-dev cyclonedds-tools gcc")


def test_node_and_client_talk_and_nobody_else_is_heard(tmp_path):
    # Where no node is, nor those of tests that run side by side with this one.
    domain = 1 + (int(os.environ["ROS_DOMAIN_ID"]) + 50) % 101
    keystore = Keystore(tmp_path, domain)
    profiles = {item.get("node"): item for item in ElementTree.parse(POLICY).iter("profile")}
    node = keystore.enclave("/hmcvt", *rules(profiles["hmcvt"]))
    client = keystore.enclave("/bench_player", *rules(profiles["bench_player"]))
    stranger = keystore.enclave("/stranger", {"rt/chatter"}, {"rt/chatter"})
    program = build(tmp_path)

    def start(configuration, *topics):
        environment = {**os.environ, "CYCLONEDDS_URI": configuration, "LD_LIBRARY_PATH": PLUGINS[0]}
        return subprocess.Popen([program, str(domain), str(SECONDS), *topics], env=environment,
                                stdout=subprocess.PIPE, text=True)

    running = [
        start(node, "rrt/engine_speed", "rrt/load_torque", "wrt/efficiency", "wrt/cmd_vel"),
        start(client, "wrt/engine_speed", "rrt/efficiency", "wrt/efficiency"),
        start(stranger, "wrt/load_torque", "rrt/efficiency"),
        start(settings(), "wrt/load_torque", "rrt/efficiency"),
    ]
    said = [dict(line.split() for line in process.communicate(timeout=60)[0].splitlines())
            for process in running]
    assert said == [
        {"rrt/engine_speed": "heard", "rrt/load_torque": "silent", "wrt/efficiency": "allowed",
         "wrt/cmd_vel": "refused"},
        {"wrt/engine_speed": "allowed", "rrt/efficiency": "heard", "wrt/efficiency": "refused"},
        {"wrt/load_torque": "refused", "rrt/efficiency": "refused"},
        {"wrt/load_torque": "allowed", "rrt/efficiency": "silent"},  # by itself, heard by no one
    ]
