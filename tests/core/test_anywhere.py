# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Windows and macOS: what Python lacks there is taken away, and the commands work all the same."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TAKEN = """
import os, signal, sys
{stand_in}
for name in ("fcntl", "grp", "pwd", "resource", "termios", "pty"):
    sys.modules[name] = None
for module, names in ((os, ("sched_getaffinity", "fchmod", "chown", "getuid", "geteuid", "fork",
                            "sched_setscheduler", "nice", "mkfifo", "setsid")),
                      (signal, ("pthread_sigmask", "SIG_BLOCK", "SIG_SETMASK", "SIGKILL",
                                "SIGUSR1", "SIGHUP"))):
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
"""
# What Windows has in place of fcntl, with the lock of this machine behind it.
MSVCRT = """
import asyncio, fcntl, subprocess, types
there = types.ModuleType("msvcrt")
there.LK_NBLCK = 2
there.locking = lambda file, mode, count: fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
sys.modules["msvcrt"] = there
"""


def run(code, folder, stand_in=""):
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", TAKEN.format(stand_in=stand_in) + code], cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=100)


@pytest.mark.parametrize("arguments", [
    "identify {table} --out p.yaml", "predict {table} --json", "breakdown --displacement-ratio 0.5 "
    "--engine-speed 1400rpm --load-torque 200 --picture b.svg", "map --out map.csv --steps 3 3 3",
    "watch {table}", "import {table} --out b.csv --yes"])
def test_commands_where_much_of_posix_is_missing(tmp_path, arguments):
    words = arguments.format(table=ROOT / "data" / "table2.csv").split()
    done = run(f"from hmcvt_core.cli import main\nmain({words!r})", tmp_path)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr


def test_a_fleet_holds_its_folder_with_the_lock_of_windows(tmp_path):
    code = """
from pathlib import Path
from hmcvt_core import InputError
from hmcvt_core.fleet.executors import _interrupt_later
from hmcvt_core.fleet.run import locked
with locked(Path("out")), _interrupt_later():
    try:
        with locked(Path("out")):
            print("twice")
    except InputError as error:
        print(error)
with locked(Path("out")):
    print("free")
from hmcvt_core.cli.fleet import _cores
print(_cores() >= 1)
"""
    done = run(code, tmp_path, MSVCRT)
    assert done.stdout.splitlines() == [
        "out: another hmcvt fleet writes there now", "free", "True"], done.stderr


def test_the_pages_quote_as_cmd_does():
    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        for line in page.read_text(encoding="utf-8").splitlines():
            if line.strip().startswith(("hmcvt ", "pip ", "python ")):
                assert "'" not in line.partition("#")[0], (page, line)
