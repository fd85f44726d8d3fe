# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Fixtures that run the real node in a process of its own and talk to it over DDS.

Without rclpy these tests fail; on purpose they are left out with HMCVT_CORE_ONLY=1 only.
"""

import dataclasses
import itertools
import json
import os
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
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
    os.environ["ROS_DOMAIN_ID"] = str(
        1 + os.getpid() % 50
    )  # the demonstration takes the others

    import rclpy
    from rcl_interfaces.srv import SetParameters
    from rclpy.context import Context
    from rclpy.node import Node
    from rclpy.parameter import Parameter
    from rclpy.signals import SignalHandlerOptions
    from ros_bench import command, send_table, without_middleware

    import hmcvt_core as hmcvt
    from examples.bench_player import BenchPlayer, Reply
    from hmcvt_ros.inputs import OperatingPoint
    from hmcvt_ros.parameters import PARAMETERS

_numbers = itertools.count(1)

ANCHORS: list["Node"] = []
"""Nodes that hold their participant of DDS until the process ends."""


def pytest_terminal_summary(terminalreporter: Any) -> None:
    if CORE_ONLY:
        terminalreporter.write_line(
            "HMCVT_CORE_ONLY=1: the tests over ROS 2 were left out"
        )


if not CORE_ONLY:

    class Client(BenchPlayer):
        """Waits longer for a reply: a refit has to wait while other tests want the cores."""

        def call(self, service: str, timeout: float = 100.0) -> Reply:
            return super().call(service, timeout)


BUSY = os.cpu_count() or 1
"""Load of the machine from which an idle priority gets nothing in the time of a test."""

START_LIMIT = 120.0
"""Time for the start of a node on a machine whose processors are all busy [s]."""

RAISED: set[int] = set()
"""Workers whose priority the tests have raised."""


class Boost:
    """Lets the workers of nodes compute on a machine that is busy with something else.

    A worker computes only while no other process wants to, so that a test of what it computes would
    wait for the other programs of the machine.
    """

    def __init__(self) -> None:
        self._nodes: list[int] = []
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def add(self, pid: int) -> None:
        """Take a node."""
        self._nodes.append(pid)

    def close(self) -> None:
        """End the thread."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ended.wait(0.5):
            if os.getloadavg()[0] < BUSY:
                continue
            for pid in self._nodes:
                with suppress(OSError):
                    self._raise_children(pid)

    def _raise_children(self, pid: int) -> None:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text()
        for child in map(int, children.split()):
            RAISED.add(child)
            os.sched_setscheduler(child, os.SCHED_OTHER, os.sched_param(0))
            for task in Path(f"/proc/{child}/task").iterdir():
                os.sched_setscheduler(int(task.name), os.SCHED_OTHER, os.sched_param(0))


class NodeUnderTest:
    """A node process and a client of it."""

    def __init__(
        self,
        process: subprocess.Popen[bytes],
        log: Path,
        state: Path,
        namespace: str,
        connect: Callable[[str], BenchPlayer],
    ) -> None:
        self.process, self.log_file, self.state, self.namespace = (
            process,
            log,
            state,
            namespace,
        )
        self.connect = connect
        self.player = connect(namespace)
        self._clients: dict[str, Any] = {}

    @property
    def log(self) -> str:
        return without_middleware(self.log_file.read_text())

    def says(self, text: str) -> bool:
        """Wait for a text in what the node logs."""
        return self.player.wait_until(lambda: text in self.log, 5.0)

    @property
    def bench_file(self) -> Path:
        return self.state / "bench_samples.csv"

    def logged(self) -> int:
        """Rows in the bench log."""
        lines = (
            self.bench_file.read_bytes().count(b"\n") if self.bench_file.exists() else 0
        )
        return max(lines - 1, 0)

    def value(self, key: str, part: str = "model") -> str:
        """What the last diagnostics say under a key; empty before they say it."""
        return str(self.status(part)["values"].get(key, ""))

    def status(self, part: str = "model") -> dict[str, Any]:
        """The last diagnostics, with nothing in them before they come."""
        found: dict[str, Any] = self.player.statuses.get(
            part, {"level": None, "message": "", "values": {}}
        )
        return found

    def forget_status(self) -> None:
        """Forget the last diagnostics, and what waits to be read of them."""
        self.player.spin_for(0.05)
        self.player.statuses.clear()

    def comes(self, condition: Callable[[], Any], timeout: float = 5.0) -> bool:
        """Wait for a condition."""
        return self.player.wait_until(lambda: bool(condition()), timeout)

    def reports(
        self,
        level: bytes,
        *words: str,
        part: str = "model",
        send: OperatingPoint | None = None,
        timeout: float = 5.0,
    ) -> bool:
        """Wait for diagnostics with a level and words; from now on, where a point is sent."""
        if send is not None:
            self.forget_status()

        def found() -> bool:
            if send is not None:
                self.player.send_inputs(send)
            status = self.status(part)
            return status["level"] == level and all(
                word in status["message"] for word in words
            )

        return self.comes(found, timeout)

    def running(self, service: str) -> Any:
        """Call a service and wait until its job runs; return the future of the reply."""
        already = self.log.count(f"{service}: started")
        reply = self.player.request(service)
        assert self.comes(lambda: self.log.count(f"{service}: started") > already)
        return reply

    def call(self, kind: Any, service: str, **request: Any) -> Any:
        """Call a service of rclpy's own; return the reply.

        A reply is lost when the client knows the node before the node knows the client. Then it
        is asked once more: what these services do may be done twice.
        """
        if service not in self._clients:
            name = f"{self.namespace}/hmcvt/{service}"
            self._clients[service] = self.player.create_client(kind, name)
        client = self._clients[service]
        assert self.comes(client.service_is_ready, 10.0)
        for _ in range(2):
            future = client.call_async(kind.Request(**request))
            if self.comes(future.done, 20.0):
                return future.result()
            client.remove_pending_request(future)
        raise TimeoutError(f"{service} did not reply")

    def set(self, **parameters: Any) -> Any:
        """Set parameters, `__` for a dot; return the results."""
        messages = [
            Parameter(name.replace("__", "."), value=value).to_parameter_msg()
            for name, value in parameters.items()
        ]
        return self.call(SetParameters, "set_parameters", parameters=messages).results

    def reset(self) -> None:
        """Back to the model file, the default parameters and an empty log; counts stay."""
        state = self.state / "in_service.json"
        while state.exists() and json.loads(state.read_text())["in_service"]:
            assert self.player.call("revert").success
        if self.logged():
            assert self.player.call("clear_samples").success
        defaults = {}
        for item in PARAMETERS:
            if not item.read_only:
                defaults[item.name.replace(".", "__")] = item.default
        refused = [result for result in self.set(**defaults) if not result.successful]
        assert not refused, refused
        self.forget_status()

    def stop(self, number: int = signal.SIGINT) -> int:
        """Send a signal, wait for the end, return the exit code."""
        self.process.send_signal(number)
        return self.process.wait(timeout=10)

    def kill(self) -> None:
        """End it the hard way, if it still runs."""
        self.process.kill()
        self.process.wait()

    def children(self) -> list[int]:
        """Process ids of the node's children: the worker, and what Python keeps beside it."""
        path = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        return [int(pid) for pid in path.read_text().split()]

    def worker(self) -> int:
        """Process id of the worker: Python keeps another one, that clears up semaphores."""
        (found,) = (
            pid
            for pid in self.children()
            if "spawn_main" in Path(f"/proc/{pid}/cmdline").read_text()
        )
        return found


@pytest.fixture(scope="session")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, str]:
    os.environ.pop(
        "OPENBLAS_NUM_THREADS", None
    )  # a node sets it itself, for its worker
    os.environ["ROS_LOG_DIR"] = str(tmp_path_factory.mktemp("ros-log"))
    return os.environ


@contextmanager
def participant() -> Iterator[Context]:
    """Yield a context of ROS; its nodes share a participant of DDS."""
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    # The participant goes with its last node. Where others of its domain came or went just then,
    # Fast DDS has hung or crashed.
    ANCHORS.append(Node("anchor", context=context, start_parameter_services=False))
    yield context
    context.try_shutdown()


@pytest.fixture(scope="session")
def context(environment: Mapping[str, str]) -> Iterator[Context]:
    with participant() as context:
        yield context


@contextmanager
def clients(context: Context) -> Iterator[Callable[[str], BenchPlayer]]:
    """Yield what makes a client in a namespace; the clients are closed at the end."""
    with ExitStack() as opened:
        yield lambda namespace: opened.enter_context(
            closing(Client(context, namespace))
        )


@pytest.fixture(scope="session")
def connect(context: Context) -> Iterator[Callable[[str], BenchPlayer]]:
    """Make a client in a namespace."""
    with clients(context) as make:
        yield make


@pytest.fixture(scope="session")
def start_anywhere(
    connect: Callable[[str], BenchPlayer],
    environment: Mapping[str, str],
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Callable[..., NodeUnderTest]]:
    """Start a node with parameters, in a namespace of its own, and wait until it answers.

    `launcher` are the words of a command that goes before that of the node, `arguments` further
    ROS arguments; a node that is not `boosted` has to get along with a busy machine itself.
    """
    started = ExitStack()
    boost = Boost()
    started.callback(boost.close)

    def start(
        model_file: Path,
        state: Path | None = None,
        launcher: tuple[str, ...] = (),
        arguments: tuple[str, ...] = (),
        boosted: bool = True,
        connect: Callable[[str], BenchPlayer] = connect,
        **parameters: Any,
    ) -> NodeUnderTest:
        folder = tmp_path_factory.mktemp("node")
        state = state or folder / "state"
        namespace = f"/node{next(_numbers)}"
        given = {
            "model_file": model_file,
            "state_folder": state,
            "limits_at_run_time": True,
            **parameters,
        }
        with (folder / "log").open("w") as log:
            process = subprocess.Popen(
                [
                    *launcher,
                    *command(
                        *(f"{name}:={value}" for name, value in given.items()),
                        arguments=("-r", f"__ns:={namespace}", *arguments),
                    ),
                ],
                stdout=log,
                stderr=log,
            )
        node = NodeUnderTest(process, folder / "log", state, namespace, connect)
        started.callback(node.kill)
        if boosted:
            boost.add(process.pid)
        up = node.player.wait_for_node(
            START_LIMIT, running=lambda: process.poll() is None
        )
        assert up, f"the node did not come up:\n{node.log}"
        return node

    with started:
        yield start


@pytest.fixture(scope="module")
def start_node(
    start_anywhere: Callable[..., NodeUnderTest],
) -> Iterator[Callable[..., NodeUnderTest]]:
    """Start a node that lives as long as the module, as `start_anywhere` does.

    Its clients have a participant of their own: over that of the whole session, which has spoken
    with dozens of killed nodes, large requests sometimes got no reply any more.
    """
    with ExitStack() as started:
        context = started.enter_context(participant())
        connect = started.enter_context(clients(context))

        def start(*arguments: Any, **parameters: Any) -> NodeUnderTest:
            node = start_anywhere(*arguments, connect=connect, **parameters)
            started.callback(node.kill)
            return node

        yield start


@pytest.fixture(scope="session")
def paper_file() -> Path:
    """The parameter file with the triple printed in the paper, which fits the bench badly."""
    return hmcvt.data_path("params/paper.yaml")


@pytest.fixture(scope="session")
def shared_node(
    start_anywhere: Callable[..., NodeUnderTest], paper_file: Path
) -> NodeUnderTest:
    """The node that most tests use, one after the other."""
    return start_anywhere(paper_file)


@pytest.fixture
def node(shared_node: NodeUnderTest) -> NodeUnderTest:
    """A node as it is after its start, but for what it has counted."""
    shared_node.reset()
    return shared_node


@pytest.fixture(scope="session")
def refused(
    start_anywhere: Callable[..., NodeUnderTest], table2: hmcvt.BenchSamples
) -> tuple[NodeUnderTest, Any]:
    """A node of the shipped model that has refused a refit: it leads too far from that."""
    node = start_anywhere("''", reidentify_max_drift=0.02)
    send_table(node, dataclasses.replace(table2, efficiency=table2.efficiency - 0.05))
    return node, node.player.call("reidentify")


@pytest.fixture(scope="session")
def sim_node(
    start_anywhere: Callable[..., NodeUnderTest], paper_file: Path
) -> NodeUnderTest:
    """A node that follows /clock."""
    return start_anywhere(
        paper_file, use_sim_time=True, input_timeout=0.5, max_output_rate=50.0
    )
