# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the packages promise: layers, light imports, public names, Windows and macOS."""

import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest
from cli.running import TABLE2, script

import hmcvt_core as hmcvt

SOURCE = Path(hmcvt.__file__).parent
PACKAGES = sorted(
    path.parent.relative_to(SOURCE.parent)
    for name in ("hmcvt_core", "hmcvt_tools")
    for path in (SOURCE.parent / name).rglob("__init__.py")
)
HEAVY = (
    "rclpy",
    "hmcvt_tools",
    "pandas",
    "pint",
    "hmcvt_ros",
    "studies",
    "yaml",
    "jinja2",
    "matplotlib",
    "click",
    "rosbags",
)


def test_layers_hold_without_a_circle():
    """pyproject.toml names the layers; imports inside functions and for types alone count."""
    linter = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run(
        [linter, "--no-cache"],
        cwd=SOURCE.parent,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stdout
    assert "Contracts: 9 kept, 0 broken." in done.stdout


def test_import_is_light():
    loaded = set(
        script(
            "-c", "import hmcvt_core, sys; print(*sys.modules)", cwd=SOURCE.parent
        ).stdout.split()
    )
    assert "hmcvt_core.physics" in loaded
    assert not loaded & set(HEAVY)


def test_all_is_sorted_and_complete():
    assert list(hmcvt.__all__) == sorted(hmcvt.__all__)
    imported = {
        name
        for name, item in vars(hmcvt).items()
        if not name.startswith("_") and not inspect.ismodule(item)
    }
    assert imported <= set(hmcvt.__all__)


@pytest.mark.parametrize("package", PACKAGES, ids=str)
def test_a_package_lists_modules_that_it_has(package):
    folder = SOURCE.parent / package
    text = (folder / "__init__.py").read_text("utf-8").split('"""')[1]
    for name in re.findall(r"^(\w+)(?::| {2,})", text, re.MULTILINE):
        assert (folder / name).is_dir() or (folder / f"{name}.py").is_file(), name


def test_every_error_raised_on_purpose_is_one_line():
    assert str(hmcvt.InputError("a\nb\r\nc")) == "a b c"
    assert len(str(hmcvt.InputError("x" * 10_000))) == 1000
    assert issubclass(hmcvt.InputError, hmcvt.HmcvtError)
    assert issubclass(hmcvt.HmcvtError, ValueError)


# --- Windows and macOS: what Python lacks there is taken away -------------------------------------

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


def without_posix(code, folder, stand_in=""):
    return script("-c", TAKEN.format(stand_in=stand_in) + code, cwd=folder)


def test_commands_where_much_of_posix_is_missing(tmp_path):
    code = f"""
from hmcvt_tools.cli import main
for arguments in (
        "identify {TABLE2} --out p.yaml", "predict {TABLE2} --json", "breakdown "
        "--displacement-ratio 0.5 --engine-speed 1400rpm --load-torque 200 --picture b.svg",
        "map --out map.csv --steps 3 3 3", "watch {TABLE2}", "import {TABLE2} --out b.csv --yes"):
    try:
        main(arguments.split())
    except SystemExit as ended:
        print("ended", ended.code)
"""
    done = without_posix(code, tmp_path)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    assert done.stdout.count("ended 0\n") == 6, done.stdout


def test_a_fleet_holds_its_folder_with_the_lock_of_windows(tmp_path):
    code = """
from pathlib import Path
from hmcvt_core import InputError
from hmcvt_tools.fleet.executors import Processes
from hmcvt_tools.fleet.run import locked
with locked(Path("out")), Processes(1):
    try:
        with locked(Path("out")):
            print("twice")
    except InputError as error:
        print(error)
with locked(Path("out")):
    print("free")
from hmcvt_tools.cli.fleet import _cores
print(_cores() >= 1)
"""
    done = without_posix(code, tmp_path, MSVCRT)
    assert done.stdout.splitlines() == [
        "out: another hmcvt fleet writes there now",
        "free",
        "True",
    ], done.stderr


def test_the_pages_quote_as_cmd_does():
    for page in (SOURCE.parent / "README.md", *(SOURCE.parent / "docs").rglob("*.md")):
        for line in page.read_text(encoding="utf-8").splitlines():
            if line.strip().startswith(("hmcvt ", "pip ", "python ")):
                assert "'" not in line.partition("#")[0], (page, line)
