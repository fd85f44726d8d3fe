# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The command as a citizen of the shell: exit codes, files, pipes, signals, other packages."""

import array
import fcntl
import io
import os
import re
import resource
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest
from click import shell_completion

import hmcvt_core
from hmcvt_tools.cli import common
from hmcvt_tools.cli.commands import COMMANDS, HIDDEN, cli

from .running import COMMAND, POINT, ROOT, TABLE2, assert_refused, process, script

SMALL_MAP = ("map", "--steps", "11", "5", "5")


def test_bare_command_shows_help(hmcvt):
    done = hmcvt()
    assert done.code == 2 and done.out == ""
    assert "Usage: hmcvt" in done.err
    listed = [name for name in COMMANDS if name not in HIDDEN]
    assert all(f"\n  {name} " in done.err for name in listed)
    assert not any(f"\n  {name} " in done.err for name in HIDDEN)
    assert hmcvt("--help").out == hmcvt("-h").out == done.err
    assert hmcvt("--version").out.split() == [
        "hmcvt,",
        "version",
        hmcvt_core.__version__,
    ]


def test_help_loads_no_command_of_ours_and_names_those_of_ros():
    code = (
        "import sys; from hmcvt_tools.cli.commands import cli\n"
        "cli.main(['--help'], standalone_mode=False)\n"
        "print(*(name for name in sys.modules if name.startswith('hmcvt_tools.cli.')))"
    )
    done = script("-c", code, cwd=ROOT)
    assert set(done.stdout.splitlines()[-1].split()) <= {
        f"hmcvt_tools.cli.{name}"
        for name in (
            "commands",
            "common",
            "outputs",
            "progress",
            "quantities",
            "samples",
        )
    }
    assert re.search(
        r"^  import-bag +turn a recorded bag \(rosbag2\) into bench samples$",
        done.stdout,
        re.MULTILINE,
    )


@pytest.fixture
def other_package(tmp_path, monkeypatch):
    """An installed package that adds commands, one that works and some that do not."""
    info = tmp_path / "other-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: other\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[hmcvt.commands]\ngreet = other:greet\nabsent = other:absent\n"
        "needy = other_needy:command\nplain = other:__name__\npredict = other:greet\n"
    )
    (tmp_path / "other.py").write_text(
        "import click\n@click.command(short_help='say hello')\n"
        "@click.option('--loud', is_flag=True)\n"
        "def greet(loud):\n    click.echo('HELLO' if loud else 'hello')\n"
    )
    (tmp_path / "other_needy.py").write_text("import a_module_that_is_not_there")
    monkeypatch.syspath_prepend(tmp_path)


def test_commands_of_another_package(hmcvt, other_package):
    assert hmcvt("greet", "--loud").out == "HELLO\n"
    # A name of ours cannot be taken.
    assert hmcvt("predict", *POINT).out.startswith("efficiency ")
    shown = hmcvt("--help")
    assert (shown.code, shown.err) == (0, "")
    lines = [" ".join(line.split()) for line in shown.out.splitlines()]
    for line in (
        "greet say hello",
        "needy (cannot be loaded: other_needy:command)",
        "absent (cannot be loaded: other:absent)",
    ):
        assert line in lines
    assert_refused(
        hmcvt("needy"),
        "command needy (other_needy:command) cannot be loaded: "
        "ModuleNotFoundError: No module named 'a_module_that_is_not_there'",
    )
    assert_refused(hmcvt("plain"), "command plain (other:__name__) is no click command")
    assert_refused(hmcvt("unknown"), "No such command 'unknown'", "hmcvt --help")
    completed = shell_completion.BashComplete(cli, {}, "hmcvt", "_HMCVT_COMPLETE")
    offered = {item.value for item in completed.get_completions([], "")}
    assert {"greet", *COMMANDS} <= offered and not {
        "needy",
        "absent",
        "plain",
    } & offered


def test_write_that_fails_half_way_leaves_the_old_file(tmp_path):
    out = tmp_path / "map.csv"
    out.write_text("old")
    done = process(
        *SMALL_MAP,
        "--out",
        out,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000)),
    )
    assert_refused(done, f"{out}: File too large")
    assert out.read_text() == "old"
    assert list(tmp_path.iterdir()) == [out]


def test_link_stays_a_link(hmcvt, tmp_path):
    target, link = tmp_path / "map.csv", tmp_path / "current.csv"
    target.write_text("old")
    link.symlink_to(target)
    assert hmcvt(*SMALL_MAP, "--out", link).code == 0
    assert link.is_symlink()
    assert target.read_text() == hmcvt(*SMALL_MAP).out


@pytest.mark.parametrize(
    "arguments",
    [
        ("identify", "{}", "--out", "{}"),
        ("identify", "{}", "--picture", "{}"),
        ("diagnose", "{}", "--report", "{}"),
        ("diagnose", TABLE2, "--holdout", "{}", "--save-model", "{}"),
        ("diagnose", TABLE2, "--params", "{}", "--report", "{}"),
        ("import-csv", "{}", "--out", "{}", "--engine-speed", "n"),
    ],
    ids=" ".join,
)
def test_what_a_command_reads_is_not_written_over(hmcvt, tmp_path, arguments):
    path, link = tmp_path / "bench.html", tmp_path / "link.html"
    path.write_bytes(Path(TABLE2).read_bytes())
    link.symlink_to(path)
    given = [str(word).format(path) for word in arguments]
    given[len(given) - 1 - given[::-1].index(str(path))] = str(link)
    assert_refused(
        hmcvt(*given), f"{link}: is read by this command; write another file"
    )
    assert path.read_bytes() == Path(TABLE2).read_bytes()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full (Linux)")
def test_full_disk():
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*COMMAND, *SMALL_MAP],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            timeout=60,
        )
    assert done.returncode == 2
    assert done.stderr == "hmcvt: error: output: No space left on device\n"


def test_reader_that_leaves():
    # More than a pipe holds, and a reader that takes one line.
    with subprocess.Popen(
        [*COMMAND, "map", "--steps", "101", "41", "11"],
        text=True,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as running:
        assert running.stdout.readline().startswith("displacement_ratio")
        running.stdout.close()
        assert running.stderr.read() == ""
    assert running.returncode == 0


def _wait_until_read(pipe, running):
    """Return once a process has read all of a pipe; the time limit of the test bounds it."""
    waiting = array.array("i", [1])
    while running.poll() is None:
        fcntl.ioctl(pipe, termios.FIONREAD, waiting)
        if waiting[0] == 0:
            return
        time.sleep(0.05)
    raise AssertionError("the command ended before it read its file")


def test_interrupt(tmp_path):
    bench = tmp_path / "bench.csv"
    os.mkfifo(bench)
    with (
        subprocess.Popen(
            [*COMMAND, "identify", str(bench)],
            text=True,
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        ) as running,
        open(bench, "w") as pipe,
    ):
        # Once it has read the first bytes it waits for more: in the middle of its work.
        pipe.write("displacement_ratio,")
        pipe.flush()
        _wait_until_read(pipe, running)
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=250)
    assert running.returncode == 130
    assert out == "" and err.split("\n") == ["", "hmcvt: error: interrupted", ""]


class _Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize(
    ("seconds", "terminal", "shown"),
    [(3.0, True, True), (0.0, True, False), (3.0, False, False)],
)
def test_progress(monkeypatch, seconds, terminal, shown):
    stream = _Terminal() if terminal else io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    progress = common.Progress("annealing")
    progress.start -= seconds
    progress("step 5")
    assert ("annealing: step 5" in stream.getvalue()) is shown
    progress.close()
    # What was shown is wiped.
    assert stream.getvalue().endswith("\r\033[K") is shown
