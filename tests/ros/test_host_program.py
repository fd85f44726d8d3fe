# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The node within a program of somebody else: it touches nothing that is not its own."""

import multiprocessing
import os
import shutil
import threading
import time
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from importlib import metadata
from pathlib import Path

import pytest
import rclpy
from rcl_interfaces import msg
from rclpy.context import Context
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

import hmcvt_core as hmcvt
from hmcvt_ros.node import EfficiencyNode
from hmcvt_ros.state_folder import StateFolder
from hmcvt_ros.worker import Worker, _begin

ROOT = Path(__file__).resolve().parents[2]


def wait_long(seconds):
    time.sleep(seconds)


@pytest.fixture
def host(environment):
    """A context of the host program, and what makes nodes in it."""
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    nodes = []

    def make(name, **parameters):
        overrides = [Parameter(key, value=value) for key, value in parameters.items()]
        node = EfficiencyNode(
            context=context, namespace=name, parameter_overrides=overrides
        )
        nodes.append(node)
        return node

    yield context, make
    for node in nodes:
        node.close()
        node.destroy_node()
    context.try_shutdown()


def test_kill_of_a_worker_ends_no_other_process():
    other = multiprocessing.get_context("spawn").Process(target=wait_long, args=(900,))
    other.start()
    first, second = Worker(), Worker()
    try:
        # With a share of a busy processor: an idle priority may wait long.
        jobs = [
            worker.submit(wait_long, 1024, shares=True, seconds=900)
            for worker in (first, second)
        ]
        first.kill()
        with pytest.raises(BrokenProcessPool):
            jobs[0].result(120.0)
        assert other.is_alive()
        assert second.exit_status is None and not jobs[1].done()
        # The first one has another process for its next job.
        job = first.submit(abs_of, 1024, shares=True, value=-3)
        assert job.result(250.0) == 3
    finally:
        first.kill(wait=True)
        second.kill(wait=True)
        assert other.is_alive()
        other.kill()
        other.join()


def abs_of(value):
    return abs(value)


GUARDED_VERSION = "7.1.6"
"""Version of ros-rclpy of which it was tried that `Guard` reaches all that rclpy answers itself: it
exchanges the attribute `callback` of services and subscriptions that rclpy has made, for which ROS
has no other way. With another version, see that a bad request to each still ends no node
(test_attacks.py), then write it here."""
OF_RCLPY = {
    "describe_parameters",
    "get_logger_levels",
    "get_parameter_types",
    "get_parameters",
    "get_type_description",
    "list_parameters",
    "set_logger_levels",
    "set_parameters",
    "set_parameters_atomically",
}
TOO_MUCH = {
    "names": 101 * ["x"],
    "prefixes": 101 * ["x"],
    "parameters": 101 * [msg.Parameter()],
    "levels": 101 * [msg.LoggerLevel()],
    "type_name": 20_000 * "x",
}
"""Values of the fields of requests that are too large."""


def test_all_that_rclpy_answers_itself_is_guarded(host, tmp_path):
    assert metadata.version("ros-rclpy") == GUARDED_VERSION
    _, make = host
    node = make("guarded", state_folder=str(tmp_path), use_sim_time=True)
    own = {"reidentify", "diagnose", "adopt", "revert", "clear_samples", "cancel"}
    services = {item.service_name.split("/")[-1]: item for item in node.services}
    assert services.keys() - own == OF_RCLPY
    for name in OF_RCLPY:
        before = node.guard.contained
        kind = services[name].srv_type
        request = kind.Request()
        for field, value in TOO_MUCH.items():
            if hasattr(request, field):
                setattr(request, field, value)
        services[name].callback(request, kind.Response())
        assert node.guard.contained == before + 1, name
    (clock,) = (item for item in node.subscriptions if item.topic_name == "/clock")
    before = node.guard.contained
    clock.callback(None)
    assert node.guard.contained == before + 1


def test_constructor_that_fails_keeps_nothing(host, tmp_path):
    _, make = host
    threads = set(threading.enumerate())
    (tmp_path / "vehicle.yaml").write_text("no: vehicle")
    given = {"state_folder": str(tmp_path / "state")}
    for wrong in ("vehicle_file", "engine_file", "model_file"):
        with pytest.raises(hmcvt.InputError, match="vehicle"):
            make("own", **given, **{wrong: str(tmp_path / "vehicle.yaml")})
        for started in set(threading.enumerate()) - threads:
            started.join(timeout=30.0)
        assert {t for t in threading.enumerate() if t.is_alive()} <= threads
    node = make("own", **given)
    assert node.close() and node.close()
    make("own", **given)


def test_node_that_is_destroyed_keeps_nothing(host, tmp_path):
    _, make = host
    threads = set(threading.enumerate())
    make("own", state_folder=str(tmp_path)).destroy_node()
    for started in set(threading.enumerate()) - threads:
        started.join(timeout=30.0)
    assert {t for t in threading.enumerate() if t.is_alive()} <= threads
    make("own", state_folder=str(tmp_path))


@pytest.mark.parametrize("kind", [MultiThreadedExecutor, EventsExecutor])
def test_executor_that_does_not_serve_the_node_is_refused_by_name(host, tmp_path, kind):
    context, make = host
    node = make("own", state_folder=str(tmp_path))
    executor = kind(context=context)
    with pytest.raises(hmcvt.InputError, match=kind.__name__):
        executor.add_node(node)
    assert node not in executor.get_nodes() and node.executor is None
    single = SingleThreadedExecutor(context=context)
    assert single.add_node(node) and node.executor is single
    single.spin_once(timeout_sec=5.0)
    executor.shutdown()
    single.shutdown()


def test_fork_of_the_program_does_not_end_the_worker(host, tmp_path):
    _, make = host
    node = make("own", state_folder=str(tmp_path))
    worker = node._service_handlers._worker
    job = worker.submit(wait_long, 1024, seconds=900)
    child = os.fork()
    if child == 0:
        os._exit(0 if node.close() else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert worker.exit_status is None and not job.done()


def test_two_nodes_serve_in_one_program(host, tmp_path):
    context, make = host
    executor = SingleThreadedExecutor(context=context)
    nodes = [make(name, state_folder=str(tmp_path / name)) for name in ("one", "two")]
    for node in nodes:
        executor.add_node(node)
    deadline = time.monotonic() + 20.0
    while min(node.ticks for node in nodes) < 3 and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=1.0)
    assert min(node.ticks for node in nodes) >= 3
    executor.shutdown()


def test_node_that_is_closed_says_so_and_still_answers(host, tmp_path):
    context, make = host
    folder = tmp_path / "state"
    node = make("own", state_folder=str(folder), samples_file="bench.csv")
    shutil.copy(ROOT / "data" / "table2.csv", folder / "bench.csv")
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    services = node._service_handlers
    diagnosis = executor.create_task(services.answer, services.diagnose)
    deadline = time.monotonic() + 30.0
    while not (services.job and services.job.working):
        executor.spin_once(timeout_sec=0.1)
        assert time.monotonic() < deadline
    assert node.close()
    while not diagnosis.done():
        executor.spin_once(timeout_sec=0.1)
        assert time.monotonic() < deadline
    assert "diagnose: the node was closed" in diagnosis.result().message
    refit = executor.create_task(services.answer, services.reidentify)
    ticks = node.ticks
    while not refit.done():
        executor.spin_once(timeout_sec=0.1)
        assert time.monotonic() < deadline
    assert "the node was closed" in refit.result().message
    assert node.ticks == ticks
    executor.shutdown()


def test_folder_is_free_although_a_forked_process_lives_on(tmp_path):
    folder = StateFolder(tmp_path)
    asked, told = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(told)
        os.read(asked, 1)  # until the parent has ended its part
        os._exit(0)
    try:
        folder.close()
        StateFolder(tmp_path).close()
    finally:
        os.close(told)
        os.waitpid(child, 0)
        os.close(asked)


@pytest.mark.parametrize("shares", [False, True])
def test_worker_of_a_real_time_program_is_none_itself(shares):
    worker = Worker()
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except PermissionError:
        pytest.skip("needs the permission to set a real-time priority")
    try:
        # They import nothing, for which an idle priority may wait long.
        policy, nice = (
            worker.submit(job, 1024, shares=shares).result(120.0)
            for job in (
                partial(os.sched_getscheduler, 0),
                partial(os.getpriority, os.PRIO_PROCESS, 0),
            )
        )
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        worker.kill(wait=True)
    assert policy == (os.SCHED_OTHER if shares else os.SCHED_IDLE)
    assert nice == (5 if shares else 0) + os.getpriority(os.PRIO_PROCESS, 0)


@pytest.mark.parametrize(
    "option",
    [
        "allow_undeclared_parameters",
        "automatically_declare_parameters_from_overrides",
    ],
)
def test_options_that_would_add_parameters_are_refused_by_name(option):
    with pytest.raises(hmcvt.InputError, match=option):
        EfficiencyNode(**{option: True})


def test_main_module_that_is_imported_for_a_worker_makes_no_second_node(monkeypatch):
    process = multiprocessing.current_process()
    monkeypatch.setattr(process, "_inheriting", True, raising=False)
    with pytest.raises(hmcvt.InputError, match="__main__"):
        EfficiencyNode()


def test_node_that_is_destroyed_during_a_job_ends_no_executor(host, tmp_path):
    context, make = host
    node = make("own", state_folder=str(tmp_path), samples_file="bench.csv")
    shutil.copy(ROOT / "data" / "table2.csv", tmp_path / "bench.csv")
    client = rclpy.create_node("client", context=context)
    trigger = client.create_client(Trigger, "/own/hmcvt/diagnose")
    executor = SingleThreadedExecutor(context=context)
    for member in (node, client):
        executor.add_node(member)
    services = node._service_handlers
    asked = []
    deadline = time.monotonic() + 60.0
    while not (services.job and services.job.working):
        if not asked and trigger.service_is_ready():
            asked.append(trigger.call_async(Trigger.Request()))
        executor.spin_once(timeout_sec=0.1)
        assert time.monotonic() < deadline
    node.destroy_node()
    for _ in range(5):
        client.executor.wake()
        executor.spin_once(timeout_sec=0.1)  # raises what a callback raises
    assert node not in executor.get_nodes() and not asked[0].done()
    executor.shutdown()
    client.destroy_node()


def begin_with_threads(shares, answer):
    ended = threading.Event()
    thread = threading.Thread(target=ended.wait)
    thread.start()
    _begin(shares)
    tasks = [thread.native_id, threading.get_native_id()]
    policies = {os.sched_getscheduler(task) for task in tasks}
    nices = {os.getpriority(os.PRIO_PROCESS, task) for task in tasks}
    ended.set()
    answer.put((policies, nices))


@pytest.mark.parametrize("shares", [False, True])
def test_threads_of_the_main_module_have_the_priority_of_the_worker(shares):
    spawn = multiprocessing.get_context("spawn")
    answer = spawn.Queue()
    process = spawn.Process(target=begin_with_threads, args=(shares, answer))
    process.start()
    policies, nices = answer.get(timeout=120.0)
    process.join()
    nice = os.getpriority(os.PRIO_PROCESS, 0) + (5 if shares else 0)
    assert policies == {os.SCHED_OTHER if shares else os.SCHED_IDLE}
    assert nices == {nice}
