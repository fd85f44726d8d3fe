# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Fleets to run, their results without what the clock wrote, and their worker processes."""

import contextlib
import json
import runpy
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
import yaml
from cli.running import COMMAND, ROOT, Done

from hmcvt_core import data_path, load_stage
from hmcvt_tools.fleet.run import Settings, study

WORK = partial(
    study,
    Settings((load_stage(data_path("params/transmission.yaml")),), diagnosed=False),
)


def make_fleet(folder, logs, samples):
    """Make logs with the script that docs/fleet.md names."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            sys, "argv", ["", str(folder), f"--logs={logs}", f"--samples={samples}"]
        )
        runpy.run_path(str(ROOT / "examples" / "make_fleet.py"), run_name="__main__")
    return folder / "logs"


def start(*arguments, **options):
    """Start the command as a process of its own."""
    return subprocess.Popen(
        [*COMMAND, *map(str, arguments)],
        cwd=ROOT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        **options,
    )


def finish(running):
    """Wait for a command."""
    with running:
        out, err = running.communicate(timeout=250)
    return Done(running.returncode, out, err)


def results(out):
    """What a fleet left behind by file, to the last digit, without time of day and its hashes."""
    found = {}
    for path in out.rglob("*.json"):
        result = json.loads(path.read_text())
        del result["parameters_sha256"]
        found[path.relative_to(out).as_posix()] = json.dumps(result)
    for path in out.rglob("*.yaml"):
        parameters = yaml.safe_load(path.read_text())
        del parameters["provenance"]["date"], parameters["checksum"]
        found[path.relative_to(out).as_posix()] = json.dumps(parameters)
    return found


def workers(parent):
    """Process ids of the workers of a process."""
    found = []
    for folder in Path("/proc").iterdir():
        with contextlib.suppress(OSError):  # gone meanwhile
            if (
                folder.name.isdigit()
                and b"spawn_main" in (folder / "cmdline").read_bytes()
            ):
                status = (folder / "stat").read_text().rpartition(")")[2].split()
                if status[0] != "Z" and status[1] == str(parent):
                    found.append(int(folder.name))
    return found


def wait_for(condition, seconds=250.0):
    """Return the first true value of a condition."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if value := condition():
            return value
        time.sleep(0.02)
    raise AssertionError("it did not happen")
