# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A program that shares no code with the node, not even the DDS, talks to it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from ros_bench import message, points

import hmcvt_core as hmcvt

# Extra `test`; a robot with ROS from apt has no such wheel, nor has Python 3.14 yet.
pytest.importorskip("cyclonedds")
CLIENT = Path(__file__).with_name("cyclone_client.py")


def test_cyclone_dds_reads_and_feeds_the_node(node, paper_file, table2):
    asked, sample = points(table2)[:3], message(table2, 0)
    given = {
        "points": asked,
        "sample": {
            "name": sample.name,
            **{
                field: list(getattr(sample, field))
                for field in ("position", "velocity", "effort")
            },
        },
    }
    done = subprocess.run(
        [sys.executable, str(CLIENT), os.environ["ROS_DOMAIN_ID"], node.namespace],
        input=json.dumps(given),
        capture_output=True,
        text=True,
        timeout=90,
    )
    assert done.returncode == 0, done.stderr + node.log
    answer = json.loads(done.stdout)
    assert not answer["ros"]  # the client has loaded nothing of ROS or of this project

    model = hmcvt.load_model(paper_file)
    assert model.fingerprint in answer["model"]
    for point, (efficiency, optimum) in zip(asked, answer["answers"], strict=True):
        assert efficiency == model.efficiency(*point)
        best = model.optimal_displacement_ratio(point.engine_speed, point.load_torque)
        assert optimum == best.displacement_ratio

    assert node.comes(lambda: node.logged() == 1), node.log
    logged = hmcvt.read_bench(node.bench_file)
    assert logged.efficiency[0] == pytest.approx(table2.efficiency[0], rel=1e-12)
