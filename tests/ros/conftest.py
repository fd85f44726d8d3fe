# SPDX-License-Identifier: Apache-2.0
"""Fixtures that run the real node in a process of its own and talk to it over DDS.

Without rclpy these tests fail; on purpose they are left out with HMCVT_CORE_ONLY=1 only.
"""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

CORE_ONLY = os.environ.get("HMCVT_CORE_ONLY") == "1"

if CORE_ONLY:
    collect_ignore_glob = ["test_*.py"]
else:
    # Read by the message classes when they are made: a field of the wrong type then raises.
    os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 101)

    import rclpy
    from rclpy.context import Context
    from rclpy.signals import SignalHandlerOptions
    from ros_bench import command

    import hmcvt_core as hmcvt
    from hmcvt_ros.bench_player import BenchPlayer

_numbers = itertools.count(1)


def pytest_terminal_summary(terminalreporter: Any) -> None:
    if CORE_ONLY:
        terminalreporter.write_line("HMCVT_CORE_ONLY=1: the tests over ROS 2 were left out")


class NodeUnderTest:
    """A node process and a client of it."""

    def __init__(self, process: subprocess.Popen[bytes], log: Path, state: Path, namespace: str,
                 connect: Callable[[str], BenchPlayer]) -> None:
        self.process, self.log_file, self.state, self.namespace = process, log, state, namespace
        self.connect = connect
        self.player = connect(namespace)

    @property
    def log(self) -> str:
        return self.log_file.read_text()

    def says(self, text: str) -> bool:
        """Wait for a text in what the node logs."""
        return self.player.wait_until(lambda: text in self.log, 5.0)

    @property
    def bench_file(self) -> Path:
        return self.state / "bench_samples.csv"

    def stop(self, number: int = signal.SIGINT) -> int:
        """Send a signal, wait for the end, return the exit code."""
        self.process.send_signal(number)
        return self.process.wait(timeout=10)

    def children(self) -> list[int]:
        """Process ids of the node's children."""
        path = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        return [int(pid) for pid in path.read_text().split()]


@pytest.fixture(scope="session")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, str]:
    os.environ["ROS_LOG_DIR"] = str(tmp_path_factory.mktemp("ros-log"))
    return os.environ


@pytest.fixture(scope="session")
def context(environment: Mapping[str, str]) -> Iterator[Context]:
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    yield context
    context.try_shutdown()


@pytest.fixture(scope="module")
def connect(context: Context) -> Iterator[Callable[[str], BenchPlayer]]:
    """Make a client in a namespace."""
    players = []

    def connect(namespace: str) -> BenchPlayer:
        players.append(BenchPlayer(context, namespace))
        return players[-1]

    yield connect
    for player in players:
        player.close()


@pytest.fixture(scope="module")
def start_node(
    connect: Callable[[str], BenchPlayer],
    environment: Mapping[str, str],
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Callable[..., NodeUnderTest]]:
    """Start a node with parameters, in a namespace of its own, and wait until it answers.

    `launcher` are the words of a command that goes before that of the node.
    """
    nodes: list[NodeUnderTest] = []

    def start(model_file: Path, state: Path | None = None, launcher: tuple[str, ...] = (),
              **parameters: Any) -> NodeUnderTest:
        folder = tmp_path_factory.mktemp("node")
        state = state or folder / "state"
        namespace = f"/node{next(_numbers)}"
        given = {"model_file": model_file, "state_folder": state, **parameters}
        with (folder / "log").open("w") as log:
            process = subprocess.Popen(
                [*launcher, *command(*(f"{name}:={value}" for name, value in given.items()),
                                     arguments=("-r", f"__ns:={namespace}"))],
                stdout=log, stderr=log)
        node = NodeUnderTest(process, folder / "log", state, namespace, connect)
        nodes.append(node)
        up = node.player.wait_for_node(running=lambda: process.poll() is None)
        assert up, f"the node did not come up:\n{node.log}"
        return node

    yield start
    for node in nodes:
        if node.process.poll() is None:
            node.process.kill()
        node.process.wait()


@pytest.fixture(scope="session")
def paper_file() -> Path:
    """The parameter file with the triple printed in the paper, which fits the bench badly."""
    return hmcvt.data_path("params/paper.yaml")


@pytest.fixture(scope="session")
def table2() -> hmcvt.BenchSamples:
    return hmcvt.read_bench(hmcvt.data_path("data/table2.csv"))
