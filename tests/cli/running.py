# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Two ways to run the command: as its own process, and in this one where speed matters."""

import contextlib
import io
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from hmcvt_core import load_model, read_bench
from hmcvt_core.transmission.ranges import RPM
from hmcvt_tools.cli import main

ROOT = Path(__file__).resolve().parents[2]
TABLE2 = str(ROOT / "data" / "table2.csv")
HM4 = ROOT / "params" / "hm4.yaml"
TRACTOR, ENGINE = (
    str(ROOT / "params" / "tractor.yaml"),
    str(ROOT / "params" / "engine.yaml"),
)
POINT = (
    "--displacement-ratio",
    "0.5",
    "--engine-speed",
    "1400rpm",
    "--load-torque",
    "200",
)
# A warning on stderr would be a second line beside the message.
COMMAND = (sys.executable, "-W", "error", "-m", "hmcvt_tools.cli")
# Root may read and write everywhere, unless it does without these rights; others have none of them.
_PR_CAPBSET_DROP, _CAP_DAC_OVERRIDE, _CAP_DAC_READ_SEARCH = 24, 1, 2
BOUND_BY_PERMISSIONS = (
    sys.executable,
    "-c",
    f"""import ctypes, os, sys
for right in {_CAP_DAC_OVERRIDE}, {_CAP_DAC_READ_SEARCH}:
    ctypes.CDLL(None).prctl({_PR_CAPBSET_DROP}, right, 0, 0, 0)
os.execv(sys.argv[1], sys.argv[1:])""",
)
"""Put before the command of a process: permissions of files hold for it, whoever runs the tests."""


class Done(NamedTuple):
    """What a command left behind."""

    code: int
    out: str
    err: str

    @property
    def json(self):
        """The value on stdout, read as strict JSON."""

        def refuse(name):
            raise AssertionError(f"{name} is not JSON")

        return json.loads(self.out, parse_constant=refuse)


def process(*arguments, cwd=ROOT, launcher=(), **options):
    """Run the command as its own process, which a launcher may start."""
    found = subprocess.run(
        [*launcher, *COMMAND, *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=60,
        **options,
    )
    return Done(found.returncode, found.stdout, found.stderr)


def assert_refused(done, *words):
    """One line on stderr with these words, nothing on stdout, exit code 2."""
    assert done.code == 2, done
    assert done.out == ""
    assert done.err.startswith("hmcvt: error: ") and done.err.endswith("\n")
    assert done.err.count("\n") == 1, done.err
    for word in words:
        assert word in done.err, (word, done.err)


def write_raw_bench(path):
    """Write Table 2 as a bench might have done: its own names and units, torques of the shafts."""
    table2 = read_bench(TABLE2)
    model = load_model(HM4)
    speed = model.output_speed(
        table2.displacement_ratio, table2.engine_speed, table2.load_torque
    )
    columns = {
        "stroke": 100.0 * table2.displacement_ratio,
        "n_engine": table2.engine_speed / RPM,
        "M_engine": table2.load_torque / table2.efficiency,
        "n_output": speed / RPM,
        "M_output": table2.load_torque * table2.engine_speed / speed,
        "eps": table2.displacement_ratio,
        "n": table2.engine_speed / RPM,
        "M": table2.load_torque,
        "eta": 100.0 * table2.efficiency,
    }
    np.savetxt(
        path,
        np.column_stack(list(columns.values())),
        delimiter=",",
        comments="",
        header=",".join(columns),
    )


def run(*arguments):
    """Run the command in this process."""
    with (
        contextlib.redirect_stdout(io.StringIO()) as out,
        contextlib.redirect_stderr(io.StringIO()) as err,
        pytest.raises(SystemExit) as stopped,
    ):
        main([str(argument) for argument in arguments])
    return Done(stopped.value.code, out.getvalue(), err.getvalue())


def script(path, *arguments, cwd, **options):
    """Run a Python script on the package under test, with warnings as errors."""
    return subprocess.run(
        [sys.executable, "-W", "error", str(path), *map(str, arguments)],
        cwd=cwd,
        timeout=250,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        **options,
    )
