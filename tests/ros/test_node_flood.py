# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Nothing in the node grows with the number of messages."""

from __future__ import annotations

import math
import os
import time

from ros_bench import GOOD, points

from examples.bench_player import bench_sample_to_message

PAGE = os.sysconf("SC_PAGE_SIZE") / 2**20
BAD = [GOOD._replace(engine_speed=math.nan), GOOD._replace(load_torque=-1.0),
       GOOD._replace(displacement_ratio=-1.0, engine_speed=20.0, load_torque=5000.0)]


def memory(node):
    """Resident memory of the node [MB]."""
    with open(f"/proc/{node.process.pid}/statm") as file:
        return int(file.read().split()[1]) * PAGE


def flood(node, table2, seconds):
    """Send inputs, good and bad, and bench samples that are refused, as fast as it goes."""
    end, rounds = time.monotonic() + seconds, 0
    everything = [*points(table2), *BAD]
    while time.monotonic() < end:
        point = everything[rounds % len(everything)]
        # Every round another value, so that nothing can be remembered by it.
        node.player.send_inputs(point._replace(load_torque=point.load_torque + rounds * 1e-6))
        if rounds % 10 == 0:
            node.player.send_sample(bench_sample_to_message(2.0 + rounds, 100.0, 1.0, 80.0, 1.0))
        node.player.spin_for(0.001)
        rounds += 1
    return rounds


def test_memory_stays_flat_under_a_flood(start_node, paper_file, table2):
    node = start_node(paper_file, invalid_output="nan")
    flood(node, table2, 1.5)  # buffers of the middleware fill up
    before = memory(node)
    rounds = flood(node, table2, 3.0)
    assert rounds > 300
    assert memory(node) - before < 2.0, (before, memory(node), rounds)
    assert node.player.hold(GOOD).efficiency is not None
    assert node.log.count("[WARN]") < 20
