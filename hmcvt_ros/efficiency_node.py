# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The executable of the node `hmcvt`: arguments, signals, exit codes.

The process for heavy work is given this module too, as every process that Python spawns is given
the main module of its parent; so nothing that takes time to load is loaded before `main`.
"""

import gc
import math
import os
import signal
import sys
import time
from collections.abc import Sequence

PATIENCE = 10.0  # seconds, a hundred times the period of the node's timer
_TURN = 2e-4  # seconds; about what an answer takes


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM.

    Returns:
        Exit code: 0; 2 when an argument, a parameter or the model file is wrong, or ROS missing; 1
        when ROS does not call the node any more, so that whoever started it may start another.
    """
    given = list(sys.argv if arguments is None else arguments)
    asked = _stop_signals()
    try:
        import rclpy
    except ImportError as error:
        return _failed(
            f"the node needs ROS 2 ({error}): source its setup.bash, or, in the "
            'folder of hmcvt, pip install ".[ros]"'
        )
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions
    from rclpy.utilities import remove_ros_args

    from hmcvt_core import HmcvtError
    from hmcvt_core.fleet import ONE_BLAS_THREAD

    from .node import EfficiencyNode
    from .parameters import usage

    os.environ.update(
        ONE_BLAS_THREAD
    )  # for the worker process, which computes with one thread
    # The thread that waits for disks reads and maps models too: an answer waits for it no longer.
    sys.setswitchinterval(_TURN)
    try:
        other = remove_ros_args(given)[1:]
        if other[:1] in (["-h"], ["--help"]):
            print(usage())
            return 0
        if other:
            return _failed(f"unknown argument {other[0]}; see --help")
        rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
        node = EfficiencyNode()
    except (HmcvtError, OSError, RuntimeError) as error:
        rclpy.try_shutdown()
        # A RuntimeError is what rclpy raises on a parameter file or argument that it cannot read.
        kind = f"{type(error).__name__}: " if isinstance(error, RuntimeError) else ""
        return _failed(f"{kind}{error}")
    # What has been loaded stays: to look through it for garbage again and again holds up answers.
    gc.freeze()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    ticks, failed = (
        node.ticks,
        math.inf,
    )  # since when a failure has not been followed by a tick
    try:
        while not asked:
            try:
                # The node's timer wakes it up every 0.1 s, unless what failed left rclpy stuck.
                executor.spin_once(timeout_sec=None if failed == math.inf else 0.1)
            except Exception as error:  # of a callback of rclpy's own
                node.guard.contain("rclpy", error)
                # Nothing is to be waited for where ROS itself has ended.
                failed = min(
                    failed, time.monotonic() if node.context.ok() else -math.inf
                )
            if node.ticks != ticks:
                ticks, failed = node.ticks, math.inf
            elif time.monotonic() > failed + PATIENCE:
                node.get_logger().fatal("stopping: ROS does not call the node any more")
                return 1
        node.get_logger().info("stopping: asked to by a signal")
    finally:
        written = node.close()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
        if not written:  # Python would wait for that thread for ever
            _failed("the disk does not answer: what waited for it is lost")
            os._exit(1)
    return 0


def _stop_signals() -> list[int]:
    """Return a list that SIGINT and SIGTERM fill; it is looked at between two callbacks.

    The handlers of rclpy raise in the middle of whatever runs, which ends in tracebacks now and
    then. A second signal ends the process the hard way.
    """
    asked: list[int] = []

    def ask(number: int, frame: object) -> None:
        asked.append(number)
        signal.signal(number, signal.SIG_DFL)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, ask)
    return asked


def _failed(text: str) -> int:
    print(f"hmcvt: error: {' '.join(text.split())}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
