# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The processes under test, and what they use of the machine."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
_TICKS = os.sysconf("SC_CLK_TCK")
_PAGE = os.sysconf("SC_PAGE_SIZE")


class Process:
    """A process that runs, and its use of processor and memory.

    Attributes:
        log_file: where it writes.
    """

    def __init__(self, process: subprocess.Popen[bytes], log_file: Path) -> None:
        self._process, self.log_file = process, log_file

    @property
    def log(self) -> str:
        """What it has written so far."""
        return self.log_file.read_text(errors="replace")

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def cpu_seconds(self) -> float:
        """Processor time that it has used, without its children."""
        fields = (
            Path(f"/proc/{self._process.pid}/stat")
            .read_text()
            .rpartition(")")[2]
            .split()
        )
        return (int(fields[11]) + int(fields[12])) / _TICKS

    def memory(self) -> int:
        """Bytes of memory that it holds (RSS)."""
        pages = Path(f"/proc/{self._process.pid}/statm").read_text().split()[1]
        return int(pages) * _PAGE

    def kill(self) -> list[str]:
        """End it at once; return the ids of the processes that it had begun."""
        pid = self._process.pid
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        self._process.kill()
        self._process.wait()
        return children

    def stop(self) -> int:
        """Ask it to end, as Ctrl-C does; return its exit code."""
        if self.running:
            self._process.send_signal(signal.SIGINT)
        try:
            return self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()


def loopback_only(folder: Path) -> None:
    """Keep ROS, in this process and those it starts, from other machines; logs go to a folder."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 101)
    os.environ["ROS_LOG_DIR"] = str(folder / "log")


@contextmanager
def running(
    command: list[str], namespace: str, log: Path, parameters: Mapping[str, Any]
) -> Iterator[Process]:
    """Run a node in a namespace, with parameters, until the block ends."""
    given = [
        word
        for name, value in parameters.items()
        for word in ("-p", f"{name}:={value}")
    ]
    # The tests let the message classes check each field; the node is to run as it does elsewhere.
    environment = {**os.environ, "ROS_PYTHON_CHECK_FIELDS": "0"}
    with log.open("w") as output:
        process = Process(
            subprocess.Popen(
                [
                    sys.executable,
                    *command,
                    "--ros-args",
                    "-r",
                    f"__ns:={namespace}",
                    *given,
                ],
                stdout=output,
                stderr=output,
                env=environment,
                cwd=ROOT,
            ),
            log,
        )
        try:
            yield process
        finally:
            process.stop()


def node(
    namespace: str, folder: Path, **parameters: Any
) -> AbstractContextManager[Process]:
    """Run the node; its state goes into a folder."""
    name = namespace.strip("/")
    return running(
        ["-m", "hmcvt_ros.efficiency_node"],
        namespace,
        folder / f"{name}.log",
        {"state_folder": folder / name, **parameters},
    )


def relay(namespace: str, folder: Path) -> AbstractContextManager[Process]:
    """Run the relay that the node is compared with."""
    return running(
        ["-m", "studies.soak.relay"],
        namespace,
        folder / f"{namespace.strip('/')}.log",
        {},
    )
