# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The executable of the node `hmcvt`: arguments, signals, exit codes.

The process for heavy work loads this module too, as every process that Python spawns loads the main
module of its parent; so nothing that takes time is imported before `main`.
"""

from __future__ import annotations

import ctypes
import gc
import itertools
import os
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .node import EfficiencyNode

PATIENCE = 10.0
"""Time without the node's timer, after a failure, beyond which ROS counts as stuck [s]: a hundred
periods of the timer."""
_SWITCH_INTERVAL = 2e-4
"""Longest time that another thread keeps the interpreter [s]; about what an answer takes."""

HIGHEST_DOMAIN = 232
"""Highest ROS_DOMAIN_ID that has ports: 7400 + 250 for each domain, below 65536."""

WRONG_ARGUMENT = 2
"""Exit code for a wrong argument, parameter or model file, or a missing ROS."""
STUCK = 1
"""Exit code when ROS does not call the node any more; it may be started again."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM, or until its terminal is closed.

    Args:
        arguments: command line with the name of the program; None takes `sys.argv`.

    Returns:
        Exit code: 0, `WRONG_ARGUMENT` or `STUCK`.
    """
    given = list(sys.argv if arguments is None else arguments)
    signals = _stop_signals()
    try:
        _require_middleware()
        import rclpy
    except ImportError as error:
        return _failed(
            f"the node needs ROS 2 ({error}): source its setup.bash, or, in the "
            'folder of hmcvt, pip install ".[ros]"'
        )
    from rclpy.signals import SignalHandlerOptions
    from rclpy.utilities import remove_ros_args

    from hmcvt_tools import ONE_BLAS_THREAD

    from .node import EfficiencyNode
    from .parameters import applies_to, usage

    # For the worker process, which computes with one thread.
    os.environ.update(ONE_BLAS_THREAD)
    # The thread that waits for disks also reads and maps models; an answer must not wait for it.
    sys.setswitchinterval(_SWITCH_INTERVAL)
    try:
        _require_parameter_files(given)
        other = remove_ros_args(given)[1:]
        if other[:1] in (["-h"], ["--help"]):
            print(usage())
            return 0
        if other:
            return _failed(f"unknown argument {other[0]}; see --help")
        _require_domain()
        rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
        node = EfficiencyNode()
    except Exception as error:
        # rclpy has many kinds for arguments, parameters and settings that it cannot use. The reason
        # comes first: the middleware may take its time to end.
        code = _failed(_in_words(error))
        rclpy.try_shutdown()
        return code
    name = node.get_fully_qualified_name()
    for file in _parameter_files(given):
        if not applies_to(file, name):
            node.warn_of_start(
                f"{file.name} has no parameters for {name.strip('/')}: its sections are of others"
            )
    # What has been loaded stays; looking through it for garbage again and again delays answers.
    gc.freeze()
    return _run(node, signals)


def _require_middleware() -> None:
    """Refuse a middleware that is not installed: ROS would end the process while it is loaded.

    Raises:
        ImportError: it cannot be loaded.
    """
    name = os.environ.get("RMW_IMPLEMENTATION", "")
    if name:
        try:
            ctypes.CDLL(f"lib{name}.so")
        except OSError as error:
            raise ImportError(f"RMW_IMPLEMENTATION = {name}: {error}") from None


def _require_domain() -> None:
    """Refuse a domain for which the middleware ends the process, or takes 0 without a word.

    Raises:
        ValueError: it is no number, or there are no ports for it.
    """
    domain = os.environ.get("ROS_DOMAIN_ID", "").strip()
    if domain and not (domain.isdecimal() and int(domain) <= HIGHEST_DOMAIN):
        raise ValueError(f"ROS_DOMAIN_ID = {domain}; allowed 0 to {HIGHEST_DOMAIN}")


def _parameter_files(arguments: Sequence[str]) -> list[Path]:
    """Return the parameter files of a command line."""
    return [
        Path(name)
        for option, name in itertools.pairwise(arguments)
        if option == "--params-file"
    ]


def _require_parameter_files(arguments: Sequence[str]) -> None:
    """Refuse a parameter file that is a pipe: ROS reads it whenever it looks at the arguments.

    The second time it is empty, and its parameters have no effect; or ROS waits for a writer for
    ever.

    Args:
        arguments: command line.

    Raises:
        ValueError: a file is no regular file.
    """
    for path in _parameter_files(arguments):
        if path.exists() and not path.is_file():
            raise ValueError(f"--params-file {path}: is no regular file")


def _in_words(error: Exception) -> str:
    """Return why the node did not start."""
    from hmcvt_core import HmcvtError

    from .state_folder import working_directory_trouble

    if isinstance(error, FileNotFoundError) and error.filename is None:
        trouble = working_directory_trouble()
        if trouble:
            return trouble
    if isinstance(error, UnicodeError):
        return (
            "a name has characters that the locale cannot express; set LC_ALL=C.UTF-8 "
            f"or another locale of UTF-8 ({error})"
        )
    if isinstance(error, (HmcvtError, OSError, ValueError)):
        return str(error)
    return f"{type(error).__name__}: {error}"


def _run(node: EfficiencyNode, signals: list[int]) -> int:
    """Spin until a signal arrives; end the node and return the exit code."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        return _spin(node, executor, signals)
    finally:
        written = node.close()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
        if not written:  # Python would wait for that thread for ever
            _failed("the disk does not answer: what waited for it is lost")
            os._exit(STUCK)


def _spin(node: EfficiencyNode, executor: Any, signals: list[int]) -> int:
    """Serve callbacks until a signal arrives, or until the timer stays away after a failure."""
    ticks = node.ticks
    deadline: float | None = None  # for the next tick after a failure
    while not signals:
        try:
            # The node's timer wakes it every 0.1 s, unless a failure left rclpy stuck.
            executor.spin_once(timeout_sec=None if deadline is None else 0.1)
        except Exception as error:  # of a callback of rclpy itself
            node.guard.contain("rclpy", error)
            if not node.context.ok():  # ROS itself has ended
                deadline = 0.0
            elif deadline is None:
                deadline = time.monotonic() + PATIENCE
        if node.ticks != ticks:
            ticks = node.ticks
            deadline = None
        elif deadline is not None and time.monotonic() > deadline:
            node.get_logger().fatal("stopping: ROS does not call the node any more")
            return STUCK
    node.get_logger().info("stopping: asked to by a signal")
    return 0


def _stop_signals() -> list[int]:
    """Return a list that SIGINT, SIGTERM and SIGHUP fill; it is read between two callbacks.

    The handlers of rclpy raise in the middle of whatever runs, which ends in tracebacks now and
    then. A second signal ends the process at once.
    """
    received: list[int] = []

    def note(number: int, frame: object) -> None:
        received.append(number)
        signal.signal(number, signal.SIG_DFL)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, note)
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as nohup sets it
        signal.signal(signal.SIGHUP, note)
    return received


def _failed(text: str) -> int:
    print(f"hmcvt: error: {' '.join(text.split())}", file=sys.stderr)
    return WRONG_ARGUMENT


if __name__ == "__main__":
    sys.exit(main())
