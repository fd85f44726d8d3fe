# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the tests start and send: nodes, points, bench samples; and what they put in its way."""

import itertools
import mmap
import resource
import signal
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import hmcvt_core as hmcvt
from examples.bench_player import bench_message as message
from hmcvt_ros.inputs import OperatingPoint
from hmcvt_ros.model_store import ModelStore

__all__ = [
    "GOOD",
    "STALLED",
    "Shim",
    "adopted",
    "command",
    "file_limit",
    "message",
    "points",
    "read_only",
    "send_table",
    "without_middleware",
]

GOOD = OperatingPoint(displacement_ratio=0.5, engine_speed=100.0, load_torque=200.0)
STALLED = OperatingPoint(displacement_ratio=-1.0, engine_speed=20.0, load_torque=5000.0)


def without_middleware(text: str) -> str:
    """Return what a process wrote without the lines of Fast DDS.

    It writes to stdout where a port in shared memory is just being taken by another process.
    """
    lines = text.splitlines(keepends=True)
    return "".join(line for line in lines if "RTPS_TRANSPORT_SHM" not in line)


def command(*parameters: str, arguments: tuple[str, ...] = ()) -> list[str]:
    """The command line of a node with parameters `name:=value` and more ROS arguments."""
    given = itertools.chain.from_iterable(("-p", parameter) for parameter in parameters)
    return [
        sys.executable,
        "-m",
        "hmcvt_ros.efficiency_node",
        "--ros-args",
        *given,
        *arguments,
    ]


def adopted(store: ModelStore, leakage: float) -> hmcvt.EfficiencyModel:
    """Write and adopt a refit of another leakage."""
    model, path = store.in_service.model, store.new_path()
    hmcvt.save_model(
        replace(model, parameters=replace(model.parameters, leakage=leakage)), path
    )
    return store.adopt(path)


def points(samples: hmcvt.BenchSamples) -> list[OperatingPoint]:
    """The operating points of bench samples."""
    return [
        OperatingPoint(*map(float, values))
        for values in zip(
            samples.displacement_ratio,
            samples.engine_speed,
            samples.load_torque,
            strict=True,
        )
    ]


def send_table(node: Any, samples: hmcvt.BenchSamples) -> None:
    """Publish all samples and wait until they are on disk."""
    before = node.logged()
    for i in range(len(samples)):
        node.player.send_sample(message(samples, i))
    assert node.player.wait_until(
        lambda: node.logged() == before + len(samples), 10.0
    ), (node.logged(), node.log)


class Shim:
    """A library preloaded into a node (shim.c), and what it is told.

    Attributes:
        launcher: words that go before the command of the node.
    """

    def __init__(self, folder: Path) -> None:
        library, orders = folder / "shim.so", folder / "orders"
        subprocess.run(
            [
                "cc",
                "-shared",
                "-fPIC",
                "-O1",
                "-o",
                library,
                Path(__file__).with_name("shim.c"),
                "-ldl",
            ],
            check=True,
        )
        orders.write_bytes(bytes(24))
        with orders.open("r+b") as file:
            self._orders = mmap.mmap(file.fileno(), 24)
        self.launcher = ("env", f"LD_PRELOAD={library}", f"SHIM_ORDERS={orders}")

    def set_clock(self, seconds: int) -> None:
        """Set the system clock ahead."""
        self._orders[:8] = struct.pack("q", seconds)

    def stall(self, seconds: float) -> None:
        """Let the main thread stall, once."""
        self._orders[8:16] = struct.pack("q", int(seconds * 1000))

    def slow_disk(self, seconds: float) -> None:
        """Let each fsync take that long."""
        self._orders[16:] = struct.pack("q", int(seconds * 1000))


@contextmanager
def file_limit(size: int, *processes: int) -> Iterator[None]:
    """Let processes write no file beyond a size [bytes], as if the disk were full.

    Without processes this one. Python ignores the signal that goes with it, so that writes fail.
    """
    assert processes or signal.getsignal(signal.SIGXFSZ) is signal.SIG_IGN
    before = {
        process: resource.prlimit(process, resource.RLIMIT_FSIZE)
        for process in processes or (0,)
    }
    for process, (_, hard) in before.items():
        resource.prlimit(process, resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        for process, limits in before.items():
            # A worker may have ended meanwhile.
            with suppress(ProcessLookupError):
                resource.prlimit(process, resource.RLIMIT_FSIZE, limits)


@contextmanager
def read_only(*paths: Path) -> Iterator[None]:
    """Take away the right to write files and folders."""
    modes = {path: path.stat().st_mode for path in paths}
    for path, mode in modes.items():
        path.chmod(mode & ~0o222)
    try:
        yield
    finally:
        for path, mode in modes.items():
            path.chmod(mode)
