# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Ordinary faults, one at a time, against a real node over DDS.

    python -m studies.soak.faults [--only WORD] [--out FILE.md]

Each fault is something that a person or a program does to the node: odd files and folders, an
unusual environment, remappings, a program that shares the process, other nodes, unusual messages.
A node that does not start must end with code 2 and one line that names the fault. A node that
starts must answer as its model does afterwards, without a traceback, and state in /diagnostics or
in a reply what the fault costs.
"""

import math
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float32, Float64, Int32, Int64, String

import hmcvt_core as hmcvt
from examples.bench_player import BenchPlayer, bench_message
from hmcvt_core.interface import write_atomically
from hmcvt_ros import qos
from hmcvt_ros.inputs import OperatingPoint
from studies.page import table

from .processes import ROOT, loopback_only

POINT = OperatingPoint(0.5, 100.0, 200.0)
START = 60.0
"""Time for a start on a busy machine [s]."""
REPLY = 120.0
"""Time for a job on a busy machine [s]."""
TOLD = 10.0
"""Time for a word in the diagnostics [s]."""

_HOST = """
import os, signal, sys, threading, time, warnings
import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from hmcvt_ros.node import EfficiencyNode

def main():
    rclpy.init()
    {before}
    executor = SingleThreadedExecutor()
    values = dict({parameters})
    node = EfficiencyNode(
        namespace={namespace!r},
        parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
    )
    executor.add_node(node)
    {after}
    while rclpy.ok():
        try:
            executor.spin()
        except ZeroDivisionError:
            continue
        except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
            break
    node.close()
    node.destroy_node()

if __name__ == "__main__":
    main()
"""


class FallenError(Exception):
    """The node did not withstand a fault."""


def require(condition: object, what: str) -> None:
    """Raise `FallenError` unless a condition holds."""
    if not condition:
        raise FallenError(what)


class Fault(NamedTuple):
    """A fault.

    Attributes:
        kind: group of the table.
        what: fault in words.
        run: brings it about on a bench; returns what the node does, in words.
    """

    kind: str
    what: str
    run: Callable[["Bench"], str]


FAULTS: list[Fault] = []


def fault(kind: str, what: str) -> Callable[[Callable[["Bench"], str]], Any]:
    """Add a function to the faults."""

    def add(run: Callable[["Bench"], str]) -> Callable[["Bench"], str]:
        FAULTS.append(Fault(kind, what, run))
        return run

    return add


class Bench:
    """One node under test, its client and its folders.

    Attributes:
        folder: folder of the trial.
        state: state folder of the node.
        player: client of the node.
        table: eight bench samples.
    """

    def __init__(self, folder: Path, number: int) -> None:
        self.folder = folder
        self.state = folder / "state"
        self.table = hmcvt.read_bench(ROOT / "data" / "table2.csv")
        self.namespace = f"/fault{number}"
        self._log = folder / "log"
        self._opened = ExitStack()
        self.player = BenchPlayer(namespace=self.namespace)
        self._opened.callback(self.player.close)
        self._process: subprocess.Popen[bytes] | None = None

    def close(self) -> None:
        """End everything."""
        self._opened.close()

    @property
    def log(self) -> str:
        return self._log.read_text(errors="replace") if self._log.exists() else ""

    @property
    def process(self) -> subprocess.Popen[bytes]:
        assert self._process is not None
        return self._process

    def command(self, arguments: Sequence[str] = (), **parameters: Any) -> list[str]:
        """Return the command line of the node."""
        given = {"state_folder": self.state, **parameters}
        words = [sys.executable, "-m", "hmcvt_ros.efficiency_node", "--ros-args"]
        words += ["-r", f"__ns:={self.namespace}", *arguments]
        for name, value in given.items():
            words += ["-p", f"{name}:={value}"]
        return words

    def refuses(
        self,
        words: str,
        arguments: Sequence[str] = (),
        environment: Mapping[str, str | None] | None = None,
        **parameters: Any,
    ) -> str:
        """Start a node that must end with code 2 and a line with some words."""
        try:
            ended = subprocess.run(
                self.command(arguments, **parameters),
                env=_environment(environment),
                cwd=self.folder,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=START,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise FallenError("neither starts nor ends") from None
        lines = ended.stderr.strip().splitlines() or [""]
        require("Traceback" not in ended.stderr, f"a traceback: {lines[-1]}")
        require(ended.returncode == 2, f"exit code {ended.returncode}: {lines[-1]}")
        require(words in lines[-1], f"{lines[-1]!r} does not say {words!r}")
        return "does not start: exit code 2 and the reason"

    def start(
        self,
        arguments: Sequence[str] = (),
        environment: Mapping[str, str | None] | None = None,
        launcher: Sequence[str] = (),
        command: Sequence[str] | None = None,
        **parameters: Any,
    ) -> None:
        """Start a node that must serve."""
        words = [*launcher, *(command or self.command(arguments, **parameters))]
        with self._log.open("w") as output:
            self._process = subprocess.Popen(
                words,
                stdout=output,
                stderr=output,
                env=_environment(environment),
                cwd=self.folder,
            )
        self._opened.callback(_end, self._process)
        up = self.player.wait_for_node(START, lambda: self.process.poll() is None)
        require(up, f"does not come up: {self.log[-300:]}")

    def host(
        self, before: str = "pass", after: str = "pass", **parameters: Any
    ) -> None:
        """Start a program with a node in it.

        Args:
            before: statements before the node is created.
            after: statements once it is.
            parameters: of the node.
        """
        given = {"state_folder": str(self.state), **parameters}
        program = self.folder / "host.py"
        program.write_text(
            _HOST.format(
                before=before.replace("\n", "\n    "),
                after=after.replace("\n", "\n    "),
                namespace=self.namespace,
                parameters=given,
            )
        )
        self.start(command=[sys.executable, str(program)])

    def second(self, **parameters: Any) -> subprocess.Popen[bytes]:
        """Start another node of the same name."""
        words = self.command(**{"state_folder": self.folder / "second", **parameters})
        other = subprocess.Popen(
            words, stderr=subprocess.DEVNULL, env=_environment(None), cwd=self.folder
        )
        self._opened.callback(_end, other)
        return other

    def send_table(self) -> None:
        """Send eight bench samples and wait until they are logged."""
        already = len(self.rows())
        for number in range(len(self.table)):
            self.player.send_sample(bench_message(self.table, number))
        expected = already + len(self.table)
        waited = self.player.wait_until(lambda: len(self.rows()) >= expected, 20.0)
        require(waited, f"{len(self.rows())} of {expected} samples are logged")

    def rows(self) -> list[str]:
        """Return the rows of the bench log."""
        path = self.state / "bench_samples.csv"
        with suppress(OSError):
            return path.read_text(errors="replace").splitlines()[1:]
        return []

    def answers(self, model: hmcvt.EfficiencyModel | None = None) -> None:
        """Require that the node answers as a model does; as that of `~/model` by default."""
        require(self.process.poll() is None, f"ended: {self.log[-300:]}")
        answer = self.player.hold(POINT)
        if model is None:
            text = self.folder / "model.yaml"
            text.write_text(self.player.model_text or "")
            model = hmcvt.load_model(text)
        expected = float(model.efficiency(*POINT))
        given = answer.efficiency
        require(given is not None, "no answer")
        assert given is not None
        require(
            math.isclose(given, expected, rel_tol=1e-12), f"{given}, not {expected}"
        )
        require("Traceback" not in self.log, f"a traceback: {self.log[-500:]}")

    def told(self, words: str, send: bool = False) -> None:
        """Require words in a status of at least WARN."""
        self.player.statuses.clear()

        def said() -> bool:
            if send:
                self.player.send_inputs(POINT)
            return any(
                status["level"] > DiagnosticStatus.OK and words in status["message"]
                for status in self.player.statuses.values()
            )

        waited = self.player.wait_until(said, TOLD)
        messages = [status["message"] for status in self.player.statuses.values()]
        require(waited, f"{words!r} is not told: {messages}")

    def reply(self, service: str, success: bool, words: str = "") -> dict[str, Any]:
        """Call a service and require what it replies."""
        try:
            reply = self.player.call(service, REPLY)
        except TimeoutError as error:
            raise FallenError(str(error)) from None
        text = str(reply.data)
        require(reply.success == success, f"{service}: {text[:300]}")
        require(words in text, f"{service} does not say {words!r}: {text[:300]}")
        return reply.data

    def set(self, kind: Any, service: str, **parameters: Any) -> list[Any]:
        """Set parameters and return the results."""
        client = self.player.create_client(kind, f"{self.namespace}/hmcvt/{service}")
        require(self.player.wait_until(client.service_is_ready, 10.0), f"no {service}")
        request = kind.Request(
            parameters=[
                Parameter(name, value=value).to_parameter_msg()
                for name, value in parameters.items()
            ]
        )
        future = client.call_async(request)
        require(self.player.wait_until(future.done, 20.0), f"{service}: no reply")
        response = future.result()
        return list(getattr(response, "results", [])) or [response.result]

    def told_of_publisher(
        self, kind: type[Any], topic: str, profile: QoSProfile, words: str
    ) -> None:
        """Require words in a status while another node has a publisher."""
        with self.other_node("stranger") as node:
            node.create_publisher(kind, topic, profile)
            self.told(words, send=True)

    @contextmanager
    def other_node(self, name: str) -> Iterator[Node]:
        """Make another node in the namespace."""
        node = Node(name, namespace=self.namespace)
        try:
            yield node
        finally:
            node.destroy_node()


def _environment(changes: Mapping[str, str | None] | None) -> dict[str, str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    for name, value in (changes or {}).items():
        environment.pop(name, None)
        if value is not None:
            environment[name] = value
    return environment


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        process.wait(10.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


# --- files at the start ---------------------------------------------------------------------------

_FILES = "files at the start"


def _fifo(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    os.mkfifo(path)
    return path


@fault(_FILES, "`model_file` is a folder")
def _(bench: Bench) -> str:
    return bench.refuses("directory", model_file=bench.folder)


@fault(_FILES, "`model_file` is a pipe")
def _(bench: Bench) -> str:
    return bench.refuses("no regular file", model_file=_fifo(bench.folder / "m.yaml"))


@fault(_FILES, "`model_file` is an endless device")
def _(bench: Bench) -> str:
    return bench.refuses("no regular file", model_file="/dev/zero")


@fault(_FILES, "`model_file` is empty")
def _(bench: Bench) -> str:
    path = bench.folder / "empty.yaml"
    path.touch()
    return bench.refuses("empty.yaml", model_file=path)


@fault(_FILES, "`model_file` was saved as UTF-16")
def _(bench: Bench) -> str:
    path = bench.folder / "wide.yaml"
    text = hmcvt.data_path("params/hm4.yaml").read_text()
    path.write_text(text, encoding="utf-16")
    return bench.refuses("wide.yaml", model_file=path)


@fault(_FILES, "`engine_file` is a pipe")
def _(bench: Bench) -> str:
    return bench.refuses("no regular file", engine_file=_fifo(bench.folder / "e.yaml"))


@fault(_FILES, "`vehicle_file` is a pipe")
def _(bench: Bench) -> str:
    return bench.refuses("no regular file", vehicle_file=_fifo(bench.folder / "v.yaml"))


@fault(_FILES, "`effects_file` calls `sys.exit(0)`")
def _(bench: Bench) -> str:
    path = bench.folder / "mine.py"
    path.write_text("import sys\nsys.exit(0)\n")
    return bench.refuses("mine.py", effects_file=path)


@fault(_FILES, "`state_folder` is a file")
def _(bench: Bench) -> str:
    bench.state.write_text("mine")
    bench.start()
    bench.told("state_folder")
    bench.answers()
    require(bench.state.read_text() == "mine", "the file was changed")
    return "answers; WARN: no logging"


@fault(_FILES, "`state_folder` has spaces, quotes, % and letters beyond ASCII")
def _(bench: Bench) -> str:
    bench.state = bench.folder / "é %s {x} 'q' 100%"
    bench.start()
    bench.send_table()
    bench.reply("reidentify", success=True)
    bench.answers()
    require(
        bench.state.name not in str(bench.player.statuses), "the folder is disclosed"
    )
    return "serves, logs and refits"


@fault(_FILES, "`in_service.json` is a pipe")
def _(bench: Bench) -> str:
    _fifo(bench.state / "in_service.json")
    bench.start()
    bench.told("in_service.json")
    bench.answers()
    return "answers from `model_file`; WARN"


@fault(_FILES, "`starts.json` is a pipe")
def _(bench: Bench) -> str:
    _fifo(bench.state / "starts.json")
    bench.start()
    bench.answers()
    bench.send_table()
    return "serves and logs"


@fault(
    _FILES, "files of a file manager in the state folder (`0001 (1).yaml`, `٣٤.yaml`)"
)
def _(bench: Bench) -> str:
    models = bench.state / "models"
    models.mkdir(parents=True)
    for name in ("0001 (1).yaml", "٣٤٥٦.yaml", ".DS_Store", f"{10**30}.yaml"):
        (models / name).write_text("mine")
    bench.start()
    bench.send_table()
    bench.reply("reidentify", success=True)
    bench.answers()
    kept = [path for path in models.iterdir() if path.read_text() == "mine"]
    require(len(kept) == 4, "a foreign file was removed")
    return "serves and refits; the files stay"


# --- files while it runs --------------------------------------------------------------------------

_RUNNING = "files while it runs"


@fault(_RUNNING, "the bench log is replaced by a pipe")
def _(bench: Bench) -> str:
    bench.start()
    bench.send_table()
    (bench.state / "bench_samples.csv").unlink()
    _fifo(bench.state / "bench_samples.csv")
    bench.player.send_sample(bench_message(bench.table, 0))
    bench.told("no regular file")
    bench.reply("reidentify", success=False, words="no regular file")
    bench.answers()
    return "answers; refuses samples and refits; ERROR"


@fault(_RUNNING, "the bench log is replaced by a folder")
def _(bench: Bench) -> str:
    bench.start()
    bench.send_table()
    (bench.state / "bench_samples.csv").unlink()
    (bench.state / "bench_samples.csv").mkdir()
    bench.player.send_sample(bench_message(bench.table, 0))
    bench.told("no regular file")
    bench.answers()
    return "answers; refuses samples; ERROR"


@fault(_RUNNING, "an editor saves the bench log as it was two samples ago")
def _(bench: Bench) -> str:
    bench.start()
    bench.send_table()
    path = bench.state / "bench_samples.csv"
    before = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(before[:-2]))
    bench.player.send_sample(bench_message(bench.table, 0))
    bench.told("gone are samples number 7 to 8")
    bench.answers()
    return "names the two; WARN"


@fault(_RUNNING, "the bench log is saved as UTF-16")
def _(bench: Bench) -> str:
    bench.start()
    bench.send_table()
    path = bench.state / "bench_samples.csv"
    path.write_text(path.read_text(), encoding="utf-16")
    bench.reply("reidentify", success=True)
    bench.answers()
    return "reads the rows as they were"


@fault(_RUNNING, "a person moves a column of the bench log")
def _(bench: Bench) -> str:
    bench.start()
    bench.send_table()
    path = bench.state / "bench_samples.csv"
    rows = [line.split(",") for line in path.read_text().splitlines()]
    path.write_text("\n".join(",".join([row[2], *row[:2], *row[3:]]) for row in rows))
    bench.reply("reidentify", success=True)
    require(len(bench.rows()) == 8, f"{len(bench.rows())} of 8 rows")
    bench.answers()
    return "reads the rows as they were"


@fault(_RUNNING, "a line of 40 million commas in the bench log")
def _(bench: Bench) -> str:
    return _swollen(bench, b"," * 40_000_000)


@fault(_RUNNING, "40 million empty lines in the bench log")
def _(bench: Bench) -> str:
    return _swollen(bench, b"\n" * 40_000_000)


def _swollen(bench: Bench, text: bytes) -> str:
    bench.start()
    bench.send_table()
    with (bench.state / "bench_samples.csv").open("ab") as file:
        file.write(text)
    bench.player.send_sample(bench_message(bench.table, 0))
    bench.told("bench_samples.csv")
    status = Path(f"/proc/{bench.process.pid}/status").read_text()
    peak = int(status.split("VmHWM:")[1].split()[0]) / 1024
    require(peak < 400, f"{peak:.0f} MiB of memory")
    bench.answers()
    return "takes it out, or sets the file aside; WARN; memory bounded"


@fault(_RUNNING, "`models` is replaced by a file")
def _(bench: Bench) -> str:
    bench.start()
    bench.send_table()
    (bench.state / "models").write_text("mine")
    bench.reply("reidentify", success=False, words="models")
    bench.answers()
    return "refuses the refit with the reason"


@fault(_RUNNING, "`reports` is replaced by a file")
def _(bench: Bench) -> str:
    bench.start()
    bench.send_table()
    (bench.state / "reports").write_text("mine")
    data = bench.reply("diagnose", success=True)
    require(data["report"] is None and data["report_error"], "no reason for no page")
    bench.answers()
    return "diagnoses without a page, with the reason"


@fault(_RUNNING, "`samples_file` is a loop of links")
def _(bench: Bench) -> str:
    bench.start()
    (bench.state / "a.csv").symlink_to(bench.state / "b.csv")
    (bench.state / "b.csv").symlink_to(bench.state / "a.csv")
    bench.set(SetParameters, "set_parameters", samples_file="a.csv")
    bench.reply("reidentify", success=False, words="a.csv")
    bench.answers()
    return "refuses the refit with the reason"


@fault(_RUNNING, "`samples_file` is a sparse file of 1 TB")
def _(bench: Bench) -> str:
    bench.start()
    with (bench.state / "huge.csv").open("wb") as file:
        file.truncate(1 << 40)
    bench.set(SetParameters, "set_parameters", samples_file="huge.csv")
    bench.reply("reidentify", success=False)
    bench.answers()
    return "refuses the refit with the reason"


@fault(_RUNNING, "`baseline_file` is replaced by a pipe")
def _(bench: Bench) -> str:
    path = bench.folder / "sound.csv"
    shutil.copy(ROOT / "data" / "table2.csv", path)
    bench.start(baseline_file=path)
    bench.send_table()
    path.unlink()
    _fifo(path)
    bench.reply("diagnose", success=False, words="no regular file")
    bench.answers()
    return "refuses the diagnosis with the reason"


@fault(_RUNNING, "`model_file` is edited after the start")
def _(bench: Bench) -> str:
    path = bench.folder / "unit.yaml"
    shutil.copy(hmcvt.data_path("params/hm4.yaml"), path)
    before = hmcvt.load_model(path)
    bench.start(model_file=path)
    bench.send_table()
    shutil.copy(hmcvt.data_path("params/paper.yaml"), path)
    bench.reply("reidentify", success=False, words="fingerprint")
    bench.answers(before)
    return "answers as before; refuses the refit with the reason"


@fault(_RUNNING, "`model_file` is deleted after the start")
def _(bench: Bench) -> str:
    path = bench.folder / "unit.yaml"
    shutil.copy(hmcvt.data_path("params/hm4.yaml"), path)
    before = hmcvt.load_model(path)
    bench.start(model_file=path)
    bench.send_table()
    path.unlink()
    bench.reply("reidentify", success=False, words="unit.yaml")
    bench.answers(before)
    return "answers as before; refuses the refit with the reason"


# --- environment ----------------------------------------------------------------------------------

_ENVIRONMENT = "environment"


def _serves_all(bench: Bench) -> None:
    bench.send_table()
    bench.reply("reidentify", success=True)
    bench.answers()


@fault(_ENVIRONMENT, "`PYTHONOPTIMIZE=2`")
def _(bench: Bench) -> str:
    bench.start(environment={"PYTHONOPTIMIZE": "2"})
    _serves_all(bench)
    return "serves, logs and refits"


@fault(_ENVIRONMENT, "`PYTHONWARNINGS=error`")
def _(bench: Bench) -> str:
    bench.start(environment={"PYTHONWARNINGS": "error"})
    _serves_all(bench)
    bench.reply("diagnose", success=True)
    return "serves, logs, refits and diagnoses"


@fault(_ENVIRONMENT, "`TMPDIR` names no folder")
def _(bench: Bench) -> str:
    bench.start(environment={"TMPDIR": str(bench.folder / "none")})
    _serves_all(bench)
    return "serves, logs and refits"


@fault(_ENVIRONMENT, "`HOME` and `ROS_HOME` are relative")
def _(bench: Bench) -> str:
    bench.start(environment={"HOME": "home", "ROS_HOME": "ros"}, state_folder="''")
    bench.state = bench.folder / "ros" / bench.namespace[1:] / "hmcvt"
    bench.send_table()
    bench.answers()
    return "serves and logs"


@fault(_ENVIRONMENT, "standard input, output and error are closed")
def _(bench: Bench) -> str:
    bench.start(launcher=("sh", "-c", 'exec "$0" "$@" <&- >&- 2>&-'))
    _serves_all(bench)
    return "serves, logs and refits"


@fault(_ENVIRONMENT, "the disk of the ROS log is full")
def _(bench: Bench) -> str:
    bench.start(launcher=("sh", "-c", 'exec "$0" "$@" >/dev/full 2>&1'))
    _serves_all(bench)
    return "serves, logs and refits"


@fault(_ENVIRONMENT, "the program that reads its output ends")
def _(bench: Bench) -> str:
    bench.start(launcher=("sh", "-c", '("$0" "$@" & echo $! >pid; wait) 2>&1 | true'))
    bench._process = bench.process  # the shell waits for it
    _serves_all(bench)
    os.kill(int((bench.folder / "pid").read_text()), signal.SIGINT)
    return "serves, logs and refits"


@fault(_ENVIRONMENT, "only 64 files may be open")
def _(bench: Bench) -> str:
    bench.start(launcher=("sh", "-c", 'ulimit -n 64; exec "$0" "$@"'))
    bench.answers()
    bench.send_table()
    return "serves and logs"


@fault(_ENVIRONMENT, "`ROS_LOG_DIR` is a file")
def _(bench: Bench) -> str:
    path = bench.folder / "file"
    path.touch()
    return bench.refuses("log", environment={"ROS_LOG_DIR": str(path)})


@fault(_ENVIRONMENT, "`RMW_IMPLEMENTATION` names one that is not installed")
def _(bench: Bench) -> str:
    return bench.refuses("rmw_none", environment={"RMW_IMPLEMENTATION": "rmw_none"})


@fault(_ENVIRONMENT, "`ROS_DOMAIN_ID` is no number, or negative")
def _(bench: Bench) -> str:
    for value in ("first", "-1"):
        text = bench.refuses("ROS_DOMAIN_ID", environment={"ROS_DOMAIN_ID": value})
    return text


@fault(_ENVIRONMENT, "the terminal is closed (SIGHUP) while samples come")
def _(bench: Bench) -> str:
    bench.start()
    bench.send_table()
    bench.process.send_signal(signal.SIGHUP)
    code = bench.process.wait(15.0)
    require(code == 0, f"exit code {code}")
    require(len(bench.rows()) == 8, "samples are lost")
    return "ends with code 0; nothing is lost"


# --- names ----------------------------------------------------------------------------------------

_NAMES = "names"


@fault(_NAMES, "two services are remapped to one name")
def _(bench: Bench) -> str:
    return bench.refuses("services", ("-r", "~/reidentify:=job", "-r", "~/cancel:=job"))


@fault(_NAMES, "a service is remapped to a name of ROS's own")
def _(bench: Bench) -> str:
    return bench.refuses("get_param", ("-r", "~/diagnose:=hmcvt/get_parameters"))


@fault(_NAMES, "the name of the node has a space")
def _(bench: Bench) -> str:
    return bench.refuses("__node:=1 node", ("-r", "__node:=1 node"))


@fault(_NAMES, "another node has the same full name")
def _(bench: Bench) -> str:
    bench.start()
    bench.second()
    bench.told("other node", send=True)
    return "answers; WARN"


@fault(_NAMES, "a second program publishes the engine speed")
def _(bench: Bench) -> str:
    bench.start()
    words = "engine_speed: 2 publishers"
    bench.told_of_publisher(Float64, "engine_speed", qos.INPUT, words)
    bench.answers()
    return "answers; WARN"


@fault(_NAMES, "a second program publishes on `efficiency`")
def _(bench: Bench) -> str:
    bench.start()
    words = "efficiency: 2 publishers"
    bench.told_of_publisher(Float64, "efficiency", qos.OUTPUT, words)
    bench.answers()
    return "answers; WARN"


@fault(_NAMES, "a publisher of the stage is not latched")
def _(bench: Bench) -> str:
    path = hmcvt.data_path("params/tractor.yaml")
    bench.start(model_file=path)
    with bench.other_node("stranger") as node:
        publisher = node.create_publisher(String, "stage", QoSProfile(depth=1))
        bench.player.spin_for(1.0)
        publisher.publish(String(data="HM4"))
        bench.told("stage", send=True)
    return "does not hear it; silent; WARN"


# --- a program that shares the process ------------------------------------------------------------

_PROGRAM = "a program that shares the process"


@fault(_PROGRAM, "`numpy.seterr(all='raise')`")
def _(bench: Bench) -> str:
    bench.host(before="np.seterr(all='raise')")
    for point in ((-1.0, 80.0, 399.0), (0.0, 230.0, 1.0), (1.0, 20.0, 5000.0)):
        bench.player.hold(OperatingPoint(*point), patience=2.0)
    require("FloatingPointError" not in bench.log, f"{bench.log[-300:]}")
    _serves_all(bench)
    return "serves, logs and refits"


@fault(_PROGRAM, "`warnings.simplefilter('error')`")
def _(bench: Bench) -> str:
    bench.host(before="warnings.simplefilter('error')")
    _serves_all(bench)
    return "serves, logs and refits"


@fault(_PROGRAM, "SIGCHLD is ignored")
def _(bench: Bench) -> str:
    bench.host(before="signal.signal(signal.SIGCHLD, signal.SIG_IGN)")
    _serves_all(bench)
    bench.process.send_signal(signal.SIGINT)
    bench.process.wait(20.0)
    require("Traceback" not in bench.log, bench.log[-500:])
    return "serves, refits and ends"


@fault(_PROGRAM, "`os.chdir` after the start, with a relative `baseline_file`")
def _(bench: Bench) -> str:
    shutil.copy(ROOT / "data" / "table2.csv", bench.folder / "sound.csv")
    other = bench.folder / "elsewhere"
    other.mkdir()
    (other / "sound.csv").write_text("not,the,same\n1,2,3\n")
    bench.host(after=f"os.chdir({str(other)!r})", baseline_file="sound.csv")
    bench.send_table()
    # The other file has no such column at all.
    bench.reply("diagnose", success=False, words="8 samples are too few for a baseline")
    bench.answers()
    return "reads the file that was named at the start"


@fault(_PROGRAM, "`os.fork`, whose child closes the node")
def _(bench: Bench) -> str:
    bench.host(
        after=(
            "def fork():\n"
            "    if os.fork() == 0:\n"
            "        node.close()\n"
            "        os._exit(0)\n"
            "threading.Timer(6.0, fork).start()"
        )
    )
    _serves_all(bench)
    bench.player.spin_for(8.0)
    _serves_all(bench)
    return "serves, logs and refits"


@fault(_PROGRAM, "`sys.stdout = sys.stderr = None`")
def _(bench: Bench) -> str:
    bench.host(before="sys.stdout = sys.stderr = None")
    _serves_all(bench)
    return "serves, logs and refits"


@fault(_PROGRAM, "`close` during a diagnosis, and the program spins on")
def _(bench: Bench) -> str:
    bench.host(after="threading.Timer(8.0, node.close).start()")
    bench.send_table()
    reason = ""
    end = time.monotonic() + REPLY
    while "the node was closed" not in reason and time.monotonic() < end:
        reason = str(bench.player.call("diagnose", REPLY).data.get("error", ""))
    require("the node was closed" in reason, f"no reason: {reason}")
    bench.answers()
    return "answers; refuses jobs with the reason"


@fault(_PROGRAM, "a second node of the same name and folder in the program")
def _(bench: Bench) -> str:
    bench.host(
        after=(
            "try:\n"
            "    EfficiencyNode(\n"
            "        namespace=node.get_namespace(),\n"
            "        parameter_overrides=[node.get_parameter('state_folder')],\n"
            "    )\n"
            "except Exception as error:\n"
            "    print(error, flush=True)"
        )
    )
    require("in use by another node" in bench.log, bench.log[-300:])
    _serves_all(bench)
    return "refuses the second; the first serves, logs and refits"


@fault(_PROGRAM, "`destroy_node` without `close`, then another node")
def _(bench: Bench) -> str:
    folder = str(bench.state)
    bench.host(
        before=(
            "EfficiencyNode(\n"
            "    namespace='/before',\n"
            f"    parameter_overrides=[Parameter('state_folder', value={folder!r})],\n"
            ").destroy_node()"
        )
    )
    _serves_all(bench)
    return "serves, logs and refits"


@fault(_PROGRAM, "a callback of the program raises, and it spins again")
def _(bench: Bench) -> str:
    bench.host(
        after=(
            "other = rclpy.create_node('other')\n"
            "other.create_timer(0.5, lambda: 1 / 0)\n"
            "executor.add_node(other)"
        )
    )
    _serves_all(bench)
    return "serves, logs and refits"


@fault(_PROGRAM, "`sys.executable` is empty, as in an embedded Python")
def _(bench: Bench) -> str:
    bench.host(
        before="import multiprocessing.spawn\nmultiprocessing.spawn._python_exe = b''"
    )
    bench.send_table()
    bench.reply("reidentify", success=False)
    bench.answers()
    return "answers; refuses the refit with the reason"


@fault(_PROGRAM, "`rclpy.shutdown` during a refit")
def _(bench: Bench) -> str:
    bench.host(after="threading.Timer(8.0, rclpy.shutdown).start()")
    bench.send_table()
    for _ in range(20):
        bench.player.request("reidentify")
        bench.player.spin_for(0.4)
        if bench.process.poll() is not None:
            break
    code = bench.process.wait(20.0)
    require(code == 0 and "Traceback" not in bench.log, f"{code}: {bench.log[-500:]}")
    return "ends with code 0"


@fault(_PROGRAM, "the program uses up all open files")
def _(bench: Bench) -> str:
    bench.host(
        after=(
            "import resource\n"
            "resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir('/proc/self/fd')), 4096))\n"
            "hold = []\n"
            "def use_up():\n"
            "    try:\n"
            "        while True: hold.append(open('/dev/null'))\n"
            "    except OSError: pass\n"
            "threading.Timer(8.0, use_up).start()"
        )
    )
    bench.player.spin_for(10.0)
    bench.player.send_sample(bench_message(bench.table, 0))
    bench.told("Too many open files")
    bench.answers()
    return "answers; refuses samples; ERROR"


# --- messages and parameters ----------------------------------------------------------------------

_MESSAGES = "messages and parameters"


def _counted(bench: Bench, key: str) -> int:
    bench.player.statuses.clear()
    bench.player.wait_until(lambda: "model" in bench.player.statuses, TOLD)
    return int(bench.player.statuses["model"]["values"][key])


def _changed(bench: Bench, change: Callable[[JointState], None]) -> JointState:
    message = bench_message(bench.table, 0)
    change(message)
    return message


def _refused_sample(bench: Bench, change: Callable[[JointState], None]) -> str:
    bench.start()
    bench.player.send_sample(_changed(bench, change))
    waited = bench.player.wait_until(
        lambda: _counted(bench, "bench samples refused, invalid") == 1, TOLD
    )
    require(waited and not bench.rows(), "the sample is not refused")
    bench.told("bench_sample")
    bench.answers()
    return "refuses it, counts it; WARN"


@fault(_MESSAGES, "a bench sample with more power out than in")
def _(bench: Bench) -> str:
    def change(message: JointState) -> None:
        message.effort[1] *= 2.0

    return _refused_sample(bench, change)


@fault(_MESSAGES, "joints named `Engine`, `OUTPUT` and `displacement\\u00a0`")
def _(bench: Bench) -> str:
    def change(message: JointState) -> None:
        message.name = ["Engine", "OUTPUT", "displacement\u00a0"]

    return _refused_sample(bench, change)


def _with_joint(message: JointState, name: str, value: float) -> None:
    message.name = [*message.name, name]
    message.position = [*message.position, value]
    message.velocity = [*message.velocity, math.nan]
    message.effort = [*message.effort, math.nan]


@fault(_MESSAGES, "a stated standard deviation of 1e-300")
def _(bench: Bench) -> str:
    return _refused_sample(
        bench, lambda message: _with_joint(message, "efficiency_std", 1e-300)
    )


@fault(_MESSAGES, "a session of 1e300")
def _(bench: Bench) -> str:
    return _refused_sample(
        bench, lambda message: _with_joint(message, "session", 1e300)
    )


@fault(_MESSAGES, "stamps before 1970, after 2038 and with 4e9 ns")
def _(bench: Bench) -> str:
    bench.start()
    for stamp in ((-(2**31), 0), (2**31 - 1, 999_999_999), (5, 2**32 - 1)):
        sample = bench_message(bench.table, 0)
        sample.header.stamp = Time()
        sample.header.stamp._sec, sample.header.stamp._nanosec = stamp
        bench.player.send_sample(sample)
    bench.player.wait_until(lambda: len(bench.rows()) == 3, TOLD)
    require(len(bench.rows()) == 3, f"{len(bench.rows())} of 3 are logged")
    stamps = hmcvt.read_bench(bench.state / "bench_samples.csv").stamp
    assert stamps is not None
    require(np.all(stamps > 0.0), f"stamps {stamps}")
    bench.answers()
    return "logs them; before 1970 counts as without a stamp"


@fault(_MESSAGES, "sessions of -2147483648 and 2147483647")
def _(bench: Bench) -> str:
    bench.start()
    publisher = bench.player.create_publisher(Int32, "session", qos.LATCHED)
    for number, session in enumerate((-(2**31), 2**31 - 1)):
        publisher.publish(Int32(data=session))
        bench.player.spin_for(0.5)
        bench.player.send_sample(bench_message(bench.table, number))
        bench.player.spin_for(0.5)
    bench.player.wait_until(lambda: len(bench.rows()) == 2, TOLD)
    require(
        "-2147483648" in bench.rows()[0] and "2147483647" in bench.rows()[1], "lost"
    )
    bench.answers()
    return "logs both"


@fault(_MESSAGES, "a stage with a line break, and one of a million characters")
def _(bench: Bench) -> str:
    path = hmcvt.data_path("params/tractor.yaml")
    bench.start(model_file=path)
    publisher = bench.player.create_publisher(String, "stage", qos.LATCHED)
    for stage in ("HM4\nlevel: OK", "x" * 1_000_000):
        publisher.publish(String(data=stage))
        bench.told("is not known", send=True)
    longest = max(len(status["message"]) for status in bench.player.statuses.values())
    require(longest < 2000, f"a message of {longest} characters")
    publisher.publish(String(data="HM4"))
    bench.answers(hmcvt.load_model(path).stages["HM4"])
    return "silent, WARN, the text cut and escaped; answers the next stage"


@fault(
    _MESSAGES,
    "`engine_speed_limits` of NaN and infinity, by `set_parameters_atomically`",
)
def _(bench: Bench) -> str:
    bench.start()
    (result,) = bench.set(
        SetParametersAtomically,
        "set_parameters_atomically",
        optimum_hold="output_speed",
        engine_speed_limits=[math.nan, math.inf],
    )
    require(not result.successful and result.reason, "taken")
    bench.answers()
    return "refuses both, with the reason"


@fault(_MESSAGES, "parameters of another type, and `qos_overrides` at run time")
def _(bench: Bench) -> str:
    bench.start()
    results = bench.set(
        SetParameters,
        "set_parameters",
        **{
            "optimum_hold": [b"a", b"b"],
            "max_output_rate": "fast",
            "qos_overrides./efficiency.publisher.depth": 1,
        },
    )
    require(not any(result.successful for result in results), "one is taken")
    bench.answers()
    return "refuses all, with the reason"


@fault(_MESSAGES, "eight equal bench samples, then a refit and a diagnosis")
def _(bench: Bench) -> str:
    bench.start()
    for number in range(8):
        sample = bench_message(bench.table, 0)
        sample.header.stamp = Time(sec=1000 + number)
        bench.player.send_sample(sample)
    bench.player.wait_until(lambda: len(bench.rows()) == 8, TOLD)
    bench.reply("reidentify", success=False, words="1 distinct working point")
    with suppress(FallenError):
        bench.reply("diagnose", success=True)
    bench.answers()
    return "refuses the refit with the reason"


# --- files that a person has edited ---------------------------------------------------------------

_EDITED = "files that a person has edited"
_TABLE = (ROOT / "data" / "table2.csv").read_text()


def _as_windows_saves(source: Path, target: Path) -> Path:
    """Copy a text with a byte-order mark and CRLF."""
    text = source.read_text().replace("\n", "\r\n")
    target.write_bytes(b"\xef\xbb\xbf" + text.encode())
    return target


def _restarted(bench: Bench) -> None:
    bench.process.send_signal(signal.SIGINT)
    bench.process.wait(20.0)
    bench.player.model_text = None
    bench.start()


def _refitted(bench: Bench) -> None:
    bench.start()
    bench.send_table()
    bench.reply("reidentify", success=True)


def _model_lines() -> list[str]:
    """Return the lines of a parameter file without its checksum."""
    text = hmcvt.data_path("params/hm4.yaml").read_text()
    return [line for line in text.splitlines() if not line.startswith("checksum")]


def _leakage_edited(path: Path) -> None:
    """Put another leading digit into the leakage of a parameter file."""
    text = path.read_text()
    edited = re.sub(r"(leakage:\s*\{?\s*value: )\d", r"\g<1>7", text, count=1)
    require(edited != text, "there is no leakage to edit")
    path.write_text(edited)


def _rows_of_table() -> list[str]:
    return [line for line in _TABLE.splitlines() if line and line[0] != "#"]


def _with_samples_file(bench: Bench, text: str) -> None:
    bench.state.mkdir()
    (bench.state / "mine.csv").write_text(text)
    bench.start(samples_file="mine.csv")


@fault(_EDITED, "`model_file` is saved with CRLF and a byte-order mark")
def _(bench: Bench) -> str:
    source = hmcvt.data_path("params/hm4.yaml")
    bench.start(model_file=_as_windows_saves(source, bench.folder / "unit.yaml"))
    bench.answers(hmcvt.load_model(source))
    return "serves as before"


@fault(_EDITED, "`engine_file` and `vehicle_file` are saved so")
def _(bench: Bench) -> str:
    for name in ("engine.csv", "engine.yaml", "vehicle.yaml"):
        _as_windows_saves(hmcvt.data_path(f"params/{name}"), bench.folder / name)
    bench.start(
        engine_file=bench.folder / "engine.yaml",
        vehicle_file=bench.folder / "vehicle.yaml",
        optimum_hold="output_speed",
    )
    bench.answers()
    return "serves as before"


@fault(_EDITED, "a line of `model_file` stands there twice, with two values")
def _(bench: Bench) -> str:
    lines = _model_lines()
    place = next(i for i, line in enumerate(lines) if "leakage:" in line)
    lines.insert(place, lines[place].replace("value: 3", "value: 9"))
    path = bench.folder / "unit.yaml"
    path.write_text("\n".join(lines))
    return bench.refuses("leakage", model_file=path)


@fault(_EDITED, "`model_file` holds the marks of a merge conflict")
def _(bench: Bench) -> str:
    lines = _model_lines()
    lines[5:6] = ["<<<<<<< HEAD", lines[5], "=======", lines[5], ">>>>>>> other"]
    path = bench.folder / "unit.yaml"
    path.write_text("\n".join(lines))
    return bench.refuses("unit.yaml", model_file=path)


@fault(_EDITED, "`in_service.json` is saved with CRLF and a byte-order mark")
def _(bench: Bench) -> str:
    _refitted(bench)
    path = bench.state / "in_service.json"
    _as_windows_saves(path, path)
    _restarted(bench)
    bench.told("in_service.json")
    bench.answers(hmcvt.load_model(hmcvt.data_path("params/hm4.yaml")))
    return "answers from `model_file`; WARN"


@fault(_EDITED, "a number of the refit in service is edited")
def _(bench: Bench) -> str:
    _refitted(bench)
    _leakage_edited(bench.state / "models" / "0001.yaml")
    _restarted(bench)
    bench.told("0001.yaml")
    bench.answers(hmcvt.load_model(hmcvt.data_path("params/hm4.yaml")))
    return "answers from `model_file`; WARN"


@fault(_EDITED, "the staged refit is edited, or deleted, before `~/adopt`")
def _(bench: Bench) -> str:
    bench.start(reidentify_mode="stage")
    bench.send_table()
    staged = bench.reply("reidentify", success=True)["file"]
    _leakage_edited(bench.state / staged)
    bench.reply("adopt", success=False, words=staged)
    (bench.state / staged).unlink()
    bench.reply("adopt", success=False, words=staged)
    bench.answers(hmcvt.load_model(hmcvt.data_path("params/hm4.yaml")))
    return "answers as before; names the file"


@fault(_EDITED, "the last number in `bench_samples.json` is 2^53 - 1")
def _(bench: Bench) -> str:
    bench.state.mkdir()
    (bench.state / "bench_samples.json").write_text(
        '{"last": 9007199254740991, "gone": []}'
    )
    _refitted(bench)
    require(len(bench.rows()) == 8, f"{len(bench.rows())} of 8 rows")
    bench.answers()
    return "serves, logs and refits"


@fault(_EDITED, "zero bytes within the bench log and at its end, as after a power cut")
def _(bench: Bench) -> str:
    bench.start()
    bench.send_table()
    path = bench.state / "bench_samples.csv"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([*lines[:4], bytes(300), *lines[4:], bytes(4096)]))
    _restarted(bench)
    bench.told("damaged lines taken out (line 5, 10)")
    require(len(bench.rows()) == 7, f"{len(bench.rows())} of 7 rows")
    bench.answers()
    return "names the row; WARN"


@fault(_EDITED, "two nodes write to one bench log by a hard link")
def _(bench: Bench) -> str:
    bench.start()
    bench.send_table()
    folder = bench.folder / "linked"
    folder.mkdir()
    log = folder / "bench_samples.csv"
    log.hardlink_to(bench.state / "bench_samples.csv")
    other = Bench(bench.folder / "other", 1000)
    bench._opened.callback(other.close)
    other.folder.mkdir()
    other.state = folder
    other.start()
    for number in range(8):
        for sender, second in ((bench, 1000), (other, 2000)):
            sample = bench_message(bench.table, number)
            sample.header.stamp = Time(sec=second + number)
            sender.player.send_sample(sample)
    for receiver, second in ((bench, 1000), (other, 2000)):
        stamps = {f"{second + number}.0" for number in range(8)}

        def logged(receiver: Bench = receiver, stamps: set[str] = stamps) -> bool:
            return stamps <= {row.split(",")[1] for row in receiver.rows()}

        require(receiver.player.wait_until(logged, TOLD), "a sample is lost")
    bench.answers()
    return "logs each sample in its own file"


@fault(_EDITED, "`samples_file` has efficiencies in percent")
def _(bench: Bench) -> str:
    head, *rows = (row.split(",") for row in _rows_of_table())
    column = head.index("efficiency")
    for row in rows:
        row[column] = str(100.0 * float(row[column]))
    _with_samples_file(bench, "\n".join(map(",".join, (head, *rows))))
    bench.reply("reidentify", success=False, words="efficiency")
    bench.answers()
    return "refuses the refit with the reason"


@fault(_EDITED, "`samples_file` has NaN in one cell")
def _(bench: Bench) -> str:
    rows = [row.split(",") for row in _rows_of_table()]
    rows[3][1] = "nan"
    _with_samples_file(bench, "\n".join(map(",".join, rows)))
    bench.reply("reidentify", success=False, words="mine.csv")
    bench.answers()
    return "refuses the refit with the reason"


@fault(_EDITED, "half of `samples_file` states an oil temperature")
def _(bench: Bench) -> str:
    head, *rows = _rows_of_table()
    cells = [f"{row},{60 if i % 2 else ''}" for i, row in enumerate(rows)]
    _with_samples_file(bench, "\n".join([f"{head},oil_temperature", *cells]))
    bench.reply("reidentify", success=False, words="oil_temperature")
    bench.answers()
    return "refuses the refit with the reason"


@fault(_EDITED, "`samples_file` is saved with semicolons, decimal commas and CRLF")
def _(bench: Bench) -> str:
    text = "\r\n".join(_rows_of_table())
    _with_samples_file(bench, text.replace(",", ";").replace(".", ","))
    data = bench.reply("reidentify", success=True)
    require(data["samples"] == 8 and data["error_after"] < 0.03, str(data))
    bench.answers()
    return "reads the rows as they were"


@fault(_EDITED, "`effects_file` is edited while the node runs")
def _(bench: Bench) -> str:
    path = bench.folder / "mine.py"
    shutil.copy(ROOT / "examples" / "own_effect.py", path)
    bench.start(effects_file=path)
    bench.send_table()
    path.write_text(f"{path.read_text()}# edited\n")
    bench.reply("reidentify", success=False, words="mine.py was changed")
    bench.answers()
    return "answers as before; refuses the refit with the reason"


@fault(_EDITED, "`models` is removed while a refit runs")
def _(bench: Bench) -> str:
    bench.start()
    bench.send_table()
    reply = bench.player.request("reidentify")
    models = bench.state / "models"
    require(bench.player.wait_until(models.is_dir, 20.0), "no models")
    shutil.rmtree(models)
    require(bench.player.wait_until(reply.done, REPLY), "no reply")
    require("models" in reply.result().message, reply.result().message)
    bench.answers()
    return "refuses the refit with the reason"


@fault(_EDITED, "`state_folder` is a link to a folder that is not there")
def _(bench: Bench) -> str:
    bench.state.symlink_to(bench.folder / "elsewhere")
    bench.start()
    _serves_all(bench)
    return "serves, logs and refits"


@fault(_EDITED, "`state_folder` has 5000 characters")
def _(bench: Bench) -> str:
    path = bench.folder / "/".join(25 * [200 * "x"])
    return bench.refuses("state_folder", state_folder=path)


# --- further environments and starts --------------------------------------------------------------

_FURTHER = "further environments and starts"


def _serves_in(name: str, value: str) -> Callable[[Bench], str]:
    def run(bench: Bench) -> str:
        bench.start(environment={name: value})
        _serves_all(bench)
        return "serves, logs and refits"

    return run


for _name, _value in (
    ("HOME", ""),
    ("RCUTILS_COLORIZED_OUTPUT", "maybe"),
    ("RCUTILS_CONSOLE_OUTPUT_FORMAT", "{nonsense} {"),
    ("FASTRTPS_DEFAULT_PROFILES_FILE", "/none.xml"),
    ("FASTDDS_BUILTIN_TRANSPORTS", "PIGEON"),
    ("ROS_AUTOMATIC_DISCOVERY_RANGE", "GALAXY"),
    ("ROS_LOCALHOST_ONLY", "yes"),
    ("PYTHONDEVMODE", "1"),
    ("PYTHONMALLOC", "debug"),
    ("OPENBLAS_NUM_THREADS", "many"),
):
    fault(_FURTHER, f"`{_name}={_value}`")(_serves_in(_name, _value))


@fault(_FURTHER, "`ROS_STATIC_PEERS` names no address")
def _(bench: Bench) -> str:
    return bench.refuses("peer", environment={"ROS_STATIC_PEERS": "not/an address;;"})


@fault(_FURTHER, "`HOME` names a folder that cannot be made")
def _(bench: Bench) -> str:
    bench.start(environment={"HOME": "/proc/none", "ROS_HOME": None}, state_folder="''")
    bench.told("state_folder")
    bench.answers()
    return "answers; WARN: no logging"


@fault(_FURTHER, "a parameter file has a section for another node, or is empty")
def _(bench: Bench) -> str:
    path = bench.folder / "p.yaml"
    path.write_text("efficiency_node:\n  ros__parameters:\n    optimum_hold: none\n")
    bench.start(("--params-file", str(path)))
    bench.told("p.yaml has no parameters for", send=True)
    bench.process.send_signal(signal.SIGINT)
    bench.process.wait(20.0)
    path.write_text("")
    bench.start(("--params-file", str(path)))
    bench.told("p.yaml has no parameters for", send=True)
    bench.answers()
    return "answers; WARN"


@fault(_FURTHER, "a parameter file lacks `ros__parameters`, or has a tab")
def _(bench: Bench) -> str:
    path = bench.folder / "p.yaml"
    path.write_text("/**:\n\tros__parameters:\n")
    bench.refuses("p.yaml", ("--params-file", str(path)))
    path.write_text("model_file: unit.yaml\n")
    return bench.refuses("p.yaml", ("--params-file", str(path)))


@fault(_FURTHER, "`vehicle_file` without `engine_file`")
def _(bench: Bench) -> str:
    bench.start(vehicle_file=hmcvt.data_path("params/vehicle.yaml"))
    bench.told("vehicle_file has no effect", send=True)
    bench.answers()
    return "answers; WARN"


@fault(_FURTHER, "a remapping is misspelt (`engin_speed:=/engine/speed`)")
def _(bench: Bench) -> str:
    bench.start(("-r", "engin_speed:=/engine/speed"))
    bench.told("engine_speed: nothing received")
    bench.answers()
    return "silent; WARN: nothing received"


for _words, _reason in (
    (("--log-level", "loud"), "loud"),
    (("-r", "__ns:=/a//b"), "a//b"),
    (("-r", "__node:="), "__node"),
    (("--log-config-file", "/none"), "external configuration"),
    (("-p", "novalue"), "novalue"),
    (("--enclave", "no slash"), "Enclave"),
):
    fault(_FURTHER, f"argument `{' '.join(_words)[:30]}`")(
        partial(Bench.refuses, words=_reason, arguments=_words)
    )


@fault(_FURTHER, "the processors are busy, and the node has a real-time priority")
def _(bench: Bench) -> str:
    bench.start(launcher=("chrt", "-f", "20"))
    bench.send_table()
    with ExitStack() as busy:
        for _ in range(os.cpu_count() or 1):
            other = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            busy.callback(other.wait)
            busy.callback(other.kill)
        bench.reply("reidentify", success=True)
        children = Path(
            f"/proc/{bench.process.pid}/task/{bench.process.pid}/children"
        ).read_text()
        for child in children.split():
            command = Path(f"/proc/{child}/cmdline").read_text()
            policy = os.sched_getscheduler(int(child))
            is_worker = "spawn_main" in command
            require(not is_worker or policy != os.SCHED_FIFO, "so has the worker")
    bench.answers()
    return "serves, logs and refits"


# --- more of a program that shares the process ----------------------------------------------------


def _own_program(bench: Bench, *changes: tuple[str, str]) -> list[str]:
    """Write a program with changes to its text; return its command line."""
    text = _HOST.format(
        before="pass",
        after="pass",
        namespace=bench.namespace,
        parameters={"state_folder": str(bench.state)},
    )
    for before, after in changes:
        text = text.replace(before, after)
    program = bench.folder / "host.py"
    program.write_text(text)
    return [sys.executable, str(program)]


@fault(_PROGRAM, 'the program has no `if __name__ == "__main__"`')
def _(bench: Bench) -> str:
    guarded = 'if __name__ == "__main__":\n    main()'
    bench.start(command=_own_program(bench, (guarded, "main()")))
    bench.send_table()
    bench.reply("reidentify", success=False, words="__main__")
    require("imports the main module" in bench.log, bench.log[-300:])
    bench._log.write_text("")
    bench.answers()
    return "answers; refuses the refit with the reason"


@fault(_PROGRAM, "the program comes from standard input")
def _(bench: Bench) -> str:
    python, program = _own_program(bench)
    bench.start(command=["sh", "-c", f"exec {python} - < {program}"])
    bench.send_table()
    bench.reply("reidentify", success=False, words="has to be a file")
    bench._log.write_text("")
    bench.answers()
    return "answers; refuses the refit with the reason"


@fault(_PROGRAM, "`rclpy.spin_once` in a loop")
def _(bench: Bench) -> str:
    command = _own_program(
        bench,
        ("executor.add_node(node)", "pass"),
        ("executor.spin()", "rclpy.spin_once(node, timeout_sec=0.05)"),
    )
    bench.start(command=command)
    _serves_all(bench)
    return "serves, logs and refits"


def _refuses_option(option: str) -> Callable[[Bench], str]:
    def run(bench: Bench) -> str:
        command = _own_program(bench, ("namespace=", f"{option}=True, namespace="))
        ended = subprocess.run(
            command,
            env=_environment(None),
            capture_output=True,
            text=True,
            timeout=START,
            check=False,
        )
        last = (ended.stderr.strip().splitlines() or [""])[-1]
        require("InputError" in last and option in last, last)
        return "refuses the option by name"

    return run


for _option in (
    "allow_undeclared_parameters",
    "automatically_declare_parameters_from_overrides",
):
    fault(_PROGRAM, f"`{_option}=True`")(_refuses_option(_option))


@fault(_PROGRAM, "a process that the program has forked outlives the node")
def _(bench: Bench) -> str:
    bench.host(after="if os.fork() == 0:\n    time.sleep(60)\n    os._exit(0)")
    bench.send_table()
    _restarted(bench)
    _serves_all(bench)
    return "leaves the folder to the next node"


@fault(_PROGRAM, "a callback of the program destroys the node during a refit")
def _(bench: Bench) -> str:
    bench.host(
        after=(
            "other = rclpy.create_node('other')\n"
            "def fall():\n"
            "    if os.path.exists('go'):\n"
            "        os.unlink('go')\n"
            "        node.destroy_node()\n"
            "        print('DESTROYED', flush=True)\n"
            "other.create_timer(0.2, fall)\n"
            "executor.add_node(other)"
        )
    )
    bench.send_table()
    bench.player.request("reidentify")
    bench.player.wait_until(lambda: "started" in bench.log, TOLD)
    (bench.folder / "go").touch()
    waited = bench.player.wait_until(lambda: "DESTROYED" in bench.log, 20.0)
    require(waited, f"hangs: {bench.log[-300:]}")
    bench.player.spin_for(1.0)
    require(bench.process.poll() is None, f"the program ends: {bench.log[-300:]}")
    require("Traceback" not in bench.log, bench.log[-300:])
    return "ends the node and its refit; the program goes on"


for _statement in (
    "sys.setrecursionlimit(150)",
    "import gc; gc.set_threshold(1)",
    "import socket; socket.setdefaulttimeout(1e-3)",
    "sys.setprofile(lambda *given: None)",
    "os.umask(0o777)",
):

    def _disturbed(bench: Bench, statement: str = _statement) -> str:
        bench.host(after=statement)
        _serves_all(bench)
        return "serves, logs and refits"

    fault(_PROGRAM, f"`{_statement}`")(_disturbed)


# --- more messages --------------------------------------------------------------------------------


@contextmanager
def _stranger(bench: Bench) -> Iterator[Node]:
    """Make a node of a participant of its own, which may have other types of a topic."""
    context = rclpy.Context()
    rclpy.init(context=context)
    node = Node("stranger", namespace=bench.namespace, context=context)
    try:
        yield node
    finally:
        node.destroy_node()
        context.try_shutdown()


@fault(_MESSAGES, "the engine speed is published as Float32, the session as Int64")
def _(bench: Bench) -> str:
    bench.start()
    with _stranger(bench) as node:
        node.create_publisher(Float32, "engine_speed", qos.INPUT)
        node.create_publisher(Int64, "session", qos.LATCHED)
        bench.told("engine_speed: stranger is not heard: it publishes std_msgs")
        bench.told("session: stranger is not heard: it publishes std_msgs/msg/Int64")
    bench.answers()
    return "answers; names the publisher and its type; WARN"


@fault(_MESSAGES, "bench samples are published best effort")
def _(bench: Bench) -> str:
    bench.start()
    words = "bench_sample: stranger is not heard"
    bench.told_of_publisher(JointState, "bench_sample", qos.INPUT, words)
    bench.answers()
    return "answers; names the publisher; WARN"


@fault(_MESSAGES, "an oil temperature in kelvin, of a model without oil")
def _(bench: Bench) -> str:
    bench.start()
    oil = bench.player.create_publisher(Float64, "oil_temperature", qos.INPUT)
    bench.player.wait_until(oil.get_subscription_count, TOLD)
    oil.publish(Float64(data=333.0))
    bench.told("oil_temperature = 333 is outside", send=True)
    bench.answers()
    return "answers; WARN"


@fault(_MESSAGES, "bytes that are no message on each plain topic of a program")
def _(bench: Bench) -> str:
    bench.host()
    create = bench.player.create_publisher
    names = ("engine_speed", "load_torque", "displacement_ratio", "oil_temperature")
    publishers = [create(Float64, name, qos.INPUT) for name in names]
    publishers.append(create(String, "stage", qos.LATCHED))
    publishers.append(create(Int32, "session", qos.LATCHED))
    for raw in (b"\0\1\0\0", b"\xff" * 11, b"\0\1\0\0\xff\xff\xff\x7f"):
        for publisher in publishers:
            # Fast DDS does not send all of them; its error is of a private type.
            with suppress(Exception):
                publisher.publish(raw)
        bench.player.spin_for(0.2)
    bench.answers()
    return "ignores them; answers"


@fault(_MESSAGES, "parameters are deleted")
def _(bench: Bench) -> str:
    bench.start()
    results = bench.set(
        SetParameters,
        "set_parameters",
        **{
            "optimum_hold": None,
            "samples_file": None,
            "engine_speed_limits": None,
            "use_sim_time": None,
            "qos_overrides./efficiency.publisher.depth": None,
        },
    )
    require(not any(result.successful for result in results), "one is deleted")
    require(all(result.reason for result in results), "one without a reason")
    bench.answers()
    return "refuses all, with the reason"


@fault(_MESSAGES, "`engine_speed_limits` are neighbours of one number")
def _(bench: Bench) -> str:
    bench.start()
    limits = [100.0, math.nextafter(100.0, 200.0)]
    bench.player.map = None
    (result,) = bench.set(SetParameters, "set_parameters", engine_speed_limits=limits)
    require(result.successful, result.reason)
    waited = bench.player.wait_until(lambda: bench.player.map is not None, TOLD)
    require(waited, "no map")
    bench.answers()
    return "answers; publishes a map"


@fault(_MESSAGES, "bench samples without a stamp, with `use_sim_time` and no /clock")
def _(bench: Bench) -> str:
    bench.start(use_sim_time=True)
    bench.send_table()
    stamps = hmcvt.read_bench(bench.state / "bench_samples.csv").stamp
    assert stamps is not None
    require(np.all(stamps > time.time() - START), f"stamps {stamps}")
    bench.told("nothing came on /clock")
    return "logs them with the wall clock; WARN"


@fault(_MESSAGES, "/clock jumps to and fro by a year at 50 Hz")
def _(bench: Bench) -> str:
    bench.start(use_sim_time=True)
    clock = bench.player.create_publisher(Clock, "/clock", 10)
    bench.player.wait_until(clock.get_subscription_count, TOLD)

    def run(seconds: Callable[[int], float]) -> None:
        for number in range(100):
            now = seconds(number)
            message = Clock()
            message.clock = Time(sec=int(now), nanosec=int(now % 1.0 * 1e9))
            clock.publish(message)
            bench.player.send_inputs(POINT)
            bench.player.spin_for(0.02)

    run(lambda number: 1e9 + 3.1e7 * (number % 2) + number)
    bench.player.efficiencies.clear()
    run(lambda number: 1.1e9 + 0.02 * number)
    require(bench.player.efficiencies, "no answer on a steady clock")
    return "answers once the clock is steady"


@fault(_MESSAGES, "all services before anything else, and five during a refit")
def _(bench: Bench) -> str:
    bench.start()
    for service in ("adopt", "revert", "cancel", "diagnose", "reidentify"):
        bench.reply(service, success=False)
    bench.send_table()
    names = ("reidentify", "diagnose", "reidentify", "adopt", "revert", "clear_samples")
    replies = [bench.player.request(name) for name in names]
    bench.set(SetParameters, "set_parameters", samples_file="none.csv")

    def answered() -> bool:
        return all(reply.done() for reply in replies)

    require(bench.player.wait_until(answered, REPLY), "one is not answered")
    bench.answers()
    return "answers each with the reason"


@fault(_MESSAGES, "SIGTERM during a refit, with four requests waiting")
def _(bench: Bench) -> str:
    bench.start()
    bench.send_table()
    for service in ("reidentify", "diagnose", "clear_samples", "revert", "reidentify"):
        bench.player.request(service)
    bench.player.wait_until(lambda: "started" in bench.log, TOLD)
    bench.process.send_signal(signal.SIGTERM)
    code = bench.process.wait(15.0)
    require(code == 0 and "Traceback" not in bench.log, f"{code}: {bench.log[-300:]}")
    return "ends with code 0"


# --- trial ----------------------------------------------------------------------------------------


def attempt(one: Fault, number: int) -> tuple[str, bool]:
    """Return what a node does under a fault, in words, and whether it withstands it."""
    with tempfile.TemporaryDirectory(prefix="hmcvt-fault-") as name:
        bench = Bench(Path(name), number)
        try:
            return one.run(bench), True
        except FallenError as error:
            return f"**falls**: {' '.join(str(error).split())[:400]}", False
        finally:
            bench.close()


@click.command("faults")
@click.option("--only", default="", help="Faults whose words contain this text.")
@click.option("--skip", type=int, default=0, help="Count of faults to leave out.")
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), default=None)
def command(only: str, skip: int, out: Path | None) -> None:
    """Bring about one fault after the other on a real node."""
    faults: dict[str, list[str]] = {}
    fallen = 0
    with tempfile.TemporaryDirectory(prefix="hmcvt-faults-") as name:
        loopback_only(Path(name))
        rclpy.init()
        for number, one in enumerate(FAULTS[skip:], skip):
            if only not in f"{one.kind}: {one.what}":
                continue
            start = time.monotonic()
            text, withstood = attempt(one, number)
            fallen += not withstood
            faults.setdefault(text, []).append(one.what)
            click.echo(f"{time.monotonic() - start:5.1f} s  {one.what}: {text}")
        rclpy.try_shutdown()
    click.echo(f"{sum(map(len, faults.values()))} faults, {fallen} fall")
    if out is not None:
        rows = [(text, "; ".join(whats)) for text, whats in faults.items()]
        write_atomically(out, table(("the node", "faults"), rows) + "\n")
    sys.exit(bool(fallen))


if __name__ == "__main__":
    command()
