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
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
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
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Int32, String

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
    with bench.other_node("stranger") as node:
        node.create_publisher(Float64, "engine_speed", qos.INPUT)
        bench.told("engine_speed: 2 publishers", send=True)
    bench.answers()
    return "answers; WARN"


@fault(_NAMES, "a second program publishes on `efficiency`")
def _(bench: Bench) -> str:
    bench.start()
    with bench.other_node("stranger") as node:
        node.create_publisher(Float64, "efficiency", qos.OUTPUT)
        bench.told("efficiency: 2 publishers", send=True)
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
