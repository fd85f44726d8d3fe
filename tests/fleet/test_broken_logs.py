# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Logs and folders as they should not be."""

import os
import shutil

import pytest
from cli.running import BOUND_BY_PERMISSIONS, assert_refused, process

from hmcvt_tools.fleet.executors import attempt
from hmcvt_tools.fleet.run import locked


def test_broken_logs_are_told_and_stop_nothing(hmcvt, logs, tmp_path):
    folder, out = tmp_path / "logs", tmp_path / "out"
    (folder / "unit7").mkdir(parents=True)
    shutil.copy(logs / "00000.csv", folder / "unit7" / "run1.CSV")
    lines = (logs / "00000.csv").read_text().splitlines(keepends=True)
    cells = lines[3].split(",")
    (folder / "nan.csv").write_text(
        "".join([*lines[:3], ",".join([cells[0], "nan", *cells[2:]])])
    )
    (folder / "rpm.csv").write_text(
        "".join([*lines[:2], ",".join([cells[0], "1400", *cells[2:]])])
    )
    (folder / "few.csv").write_text("".join(lines[:4]))
    (folder / "column.csv").write_text("time,speed\n1,2\n")
    (folder / "void.csv").write_text("")
    (folder / "noise.csv").write_bytes(os.urandom(2000))
    (folder / "link.csv").symlink_to("nowhere")
    (folder / "two\nlines.csv").write_text("")
    os.mkfifo(folder / "pipe.csv")
    # None of these is a log.
    (folder / "notes.txt").write_text("hello")
    (folder / "folder.csv").mkdir()
    (folder / ".hidden.csv").write_text("")
    done = hmcvt("fleet", folder, "--out", out, "--processes", "1", "--json")
    assert done.code == 3
    found = done.json
    assert [entry["log"] for entry in found["logs"]] == ["unit7/run1.CSV"]
    assert sorted(path.relative_to(out).as_posix() for path in out.rglob("*.*")) == [
        ".hmcvt-fleet.lock",
        "unit7/run1.json",
        "unit7/run1.yaml",
    ]
    reasons = {entry["log"]: entry["error"] for entry in found["broken"]}
    expected = {
        "nan.csv": f"{folder}/nan.csv: row 4: engine_speed = nan is not finite; "
        "allowed 10 to 320 rad/s",
        "rpm.csv": f"{folder}/rpm.csv: row 3: engine_speed = 1400 is outside 10 to 320 rad/s "
        "(is it in r/min?)",
        "few.csv": "few.csv: 3 samples",
        "column.csv": "displacement_ratio",
        "void.csv": "is empty",
        "noise.csv": "noise.csv: ",
        "link.csv": "No such file",
        "pipe.csv": "is not a file",
        r"'two\nlines.csv'": "rename the log",
    }
    assert set(reasons) == set(expected)
    for name, words in expected.items():
        assert words in reasons[name]
        assert f"hmcvt: broken: {reasons[name]}\n" in done.err
    assert found["counts"]["broken"] == 9
    # They are tried again each time, and the table for a person tells them too.
    again = hmcvt("fleet", folder, "--out", out)
    assert again.code == 3 and expected["nan.csv"] in again.out
    assert "10 logs: 0 finished now, 1 before, 9 broken" in again.out


def test_failure_inside_one_log_is_told_with_its_place():
    def fail(_):
        raise ZeroDivisionError("a\nb")

    found = attempt(fail, None)
    assert found.startswith(
        "internal failure (please report it): ZeroDivisionError: a b at"
    )
    assert "test_broken_logs.py:" in found and "\n" not in found


def test_folders_that_cannot_be_used(hmcvt, logs, tmp_path):
    out, empty, file, twins = (
        tmp_path / name for name in ("out", "empty", "file", "twins")
    )
    empty.mkdir()
    (empty / "notes.txt").write_text("")
    file.write_text("")
    twins.mkdir()
    for name in ("a.csv", "a.CSV"):
        (twins / name).write_text("")
    for folder, results, *words in [
        (empty, out, "holds no .csv file"),
        (tmp_path / "none", out, "none: No such file"),
        (file, out, "Not a directory"),
        (logs, logs / ".." / logs.name, "folder of their own"),
        (logs, file, str(file)),
        (logs, "/proc/fleet", "/proc/"),
        (twins, out, "a.csv", "a.CSV", "a.json: rename one"),
    ]:
        assert_refused(hmcvt("fleet", folder, "--out", results), *words)
    assert not out.exists()


def test_folder_that_cannot_be_read_is_not_passed_over(tmp_path):
    (tmp_path / "closed").mkdir(mode=0)
    (tmp_path / "a.csv").write_text("")
    done = process(
        "fleet", tmp_path, "--out", tmp_path / "out", launcher=BOUND_BY_PERMISSIONS
    )
    assert_refused(done, f"{tmp_path / 'closed'}: Permission denied")


def test_second_run_in_the_same_folder_is_refused(hmcvt, logs, tmp_path):
    with locked(tmp_path):
        assert_refused(
            hmcvt("fleet", logs, "--out", tmp_path), "another hmcvt fleet writes there"
        )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--processes", "2", "--scheduler", "x:1"), "give one"),
        (
            ("--params", "p.yaml", "--stage", "HM4"),
            "leave --transmission and --stage out",
        ),
        (("--no-diagnose", "--noise", "0.004"), "--no-diagnose leaves it out"),
        (("--formulation", "published"), "needs formulation power_balance"),
        (("--noise", "3"), "outside"),
        (("--params", "none.yaml"), "none.yaml"),
    ],
    ids=str,
)
def test_settings_are_refused_before_the_work(hmcvt, logs, tmp_path, options, words):
    assert_refused(hmcvt("fleet", logs, "--out", tmp_path / "out", *options), words)
    assert not (tmp_path / "out").exists()
