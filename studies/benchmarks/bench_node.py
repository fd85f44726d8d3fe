# SPDX-License-Identifier: Apache-2.0
"""The node against a bare relay: answers under load, start, imports."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest

from .turns import QUICK, in_turns

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 101)

from std_msgs.msg import Float64

from hmcvt_ros import qos
from hmcvt_ros.inputs import INPUT_RANGES
from studies.soak import phases, points, processes, trial
from studies.soak.ear import Ear
from studies.soak.load import Target

TURNS = 8
RATE = 300.0  # Hz on each input
SECONDS = 1.0 if QUICK else 3.0
ARRIVALS = 3000
STARTS = 6
PATIENCE = 20.0  # s
IMPORTS = 5
CONTENDERS = ("node", "relay")
HEAVY = ("scipy.optimize", "scipy.stats", "scipy.interpolate", "matplotlib", "pymoo", "click",
         "distributed", "rosbags")
"""What a control loop should not wait for when it starts."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("node")
    os.environ["ROS_LOG_DIR"] = str(folder / "log")
    return folder


@pytest.fixture(scope="module")
def loaded(folder, model):
    """The two processes, and what each is asked."""
    with (trial.client() as client, processes.node("/loaded_node", folder) as node,
          processes.relay("/loaded_relay", folder) as relay):
        found = {"node": (Target(client, node, "/loaded_node"),
                          points.answered(model, ARRIVALS, seed=0)),
                 "relay": (Target(client, relay, "/loaded_relay"), points.echoed(ARRIVALS, seed=0))}
        for target, _ in found.values():
            target.wait()
        yield found


@in_turns(TURNS, contender=CONTENDERS)
def bench_load(timed, loaded, contender, turn):
    target, cycle = loaded[contender]
    target.ear.listen_for(phases.REST)
    segment = timed(lambda: target.load(cycle, RATE, SECONDS), rounds=1, warm=False)
    # Inputs are best effort: a busy machine loses some, but no answer may be wrong.
    assert segment.right == segment.answers > 0.5 * segment.sent
    p50, p99 = np.percentile(segment.optimum_latency, (50, 99))
    timed.told.update(p50=p50, p99=p99, sent=segment.sent, right=segment.right, seconds=SECONDS,
                      cpu=segment.cpu * segment.seconds / segment.sent)


# --- start ----------------------------------------------------------------------------------------


@contextmanager
def asking(namespace):
    """Yield a function that publishes inputs until a process answers."""
    with trial.client() as client:
        inputs = [client.create_publisher(Float64, f"{namespace}/{limits.name}", qos.INPUT)
                  for limits in INPUT_RANGES]
        answers = []
        heard = client.create_subscription(Float64, f"{namespace}/efficiency", print, qos.OUTPUT)
        ear = Ear(client, {heard: lambda message, _: answers.append(message.data)})

        def ask(process):
            last = time.monotonic() + PATIENCE
            while not answers:
                assert process.running and time.monotonic() < last, process.log
                for publisher, value in zip(inputs, np.mean(points.ORDINARY, axis=1), strict=True):
                    publisher.publish(Float64(data=value))
                ear.listen(0.005)

        yield ask


@in_turns(STARTS, contender=CONTENDERS)
def bench_start(timed, folder, contender, turn):
    """From the command until the first answer."""
    namespace = f"/starting_{contender}_{turn}"
    run = processes.node if contender == "node" else processes.relay
    with ExitStack() as stack:
        ask = stack.enter_context(asking(namespace))

        def start():
            process = stack.enter_context(run(namespace, folder))
            ask(process)
            return process.cpu_seconds()

        timed.told["cpu"] = timed(start, rounds=1, warm=False)


# --- imports --------------------------------------------------------------------------------------

BARE = "numpy"
MESSAGES = "rclpy, rclpy.node, std_msgs.msg, sensor_msgs.msg, diagnostic_msgs.msg, std_srvs.srv"
CODE = """
import json, sys, time
begun = time.perf_counter()
import {modules}
spent = time.perf_counter() - begun
print(json.dumps([spent, sorted(sys.modules)]))
"""


@in_turns(IMPORTS, modules=("hmcvt_core", BARE, "hmcvt_ros.efficiency_node",
                            f"{MESSAGES}, {BARE}"))
def bench_import(timed, modules, turn):
    def run():
        done = subprocess.run([sys.executable, "-c", CODE.format(modules=modules)], check=True,
                              capture_output=True, text=True, cwd=processes.ROOT)
        return json.loads(done.stdout)

    spent, names = timed(run, rounds=1)
    timed.told.update(seconds=spent, heavy=[name for name in HEAVY if name in names])
