# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt import --session` and `--transmission`."""

import csv

import pytest

from hmcvt_core import read_bench
from studies.gearbox import box

from .running import assert_refused

TAKE = ("--yes", "--averaged")


@pytest.fixture
def table(hmcvt, tmp_path):
    """Return a table of the five-stage box without senses, and its gears."""
    gears = tmp_path / "gears.yaml"
    assert hmcvt("transmission", "new", gears, *box.DESCRIPTION).code == 0
    rows = box.campaign(box.Machine(), 12, 1)
    path = tmp_path / "table.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), delimiter=";")
        writer.writeheader()
        for row in rows:
            for name in ("Abtriebsdrehzahl [1/min]", "Abtriebsmoment [Nm]"):
                row[name] = abs(row[name])
            writer.writerow(row)
    return path, gears


def test_each_day_of_the_stamps_is_a_session(hmcvt, table, tmp_path):
    out = tmp_path / "bench.csv"
    done = hmcvt("import", table[0], "--out", out, *TAKE, "--session", "Datum")
    assert done.code == 0, done.err
    days = {"2026-03-09", "2026-03-10", "2026-03-11"}
    assert set(read_bench(out).extra["session"]) == days
    refused = hmcvt("import", table[0], "--out", out, *TAKE, "--session", "Tag")
    assert_refused(refused, "--session 'Tag' is no column that is kept")


def test_dates_alone_make_no_recording(hmcvt, table, tmp_path):
    """Sixty rows of three days: most steps of the stamps are zero, as of a fast logger."""
    out = tmp_path / "bench.csv"
    done = hmcvt("import", table[0], "--out", out, "--yes")
    assert done.code == 0, done.err
    assert len(read_bench(out)) == 60
    assert "each of the 3 days counts as a session" in done.out
    days = {"2026-03-09", "2026-03-10", "2026-03-11"}
    assert set(read_bench(out).extra["session"]) == days
    done = hmcvt("import", table[0], "--out", out, "--yes", "--session", "Gang")
    assert done.code == 2  # the column of the stages is used


def test_speeds_are_checked_by_the_gears(hmcvt, table, tmp_path):
    out = tmp_path / "bench.csv"
    done = hmcvt("import", table[0], "--out", out, *TAKE, "--transmission", table[1])
    assert done.code == 0, done.err
    assert "output_speed in stage R turns against the gear train" in done.out


@pytest.mark.parametrize("own_column", [False, True])
def test_days_are_no_sessions_where_sessions_are_named(hmcvt, tmp_path, own_column):
    name = "session" if own_column else "Lauf"
    lines = [f"Date,{name},stroke [%],n_engine [rpm],load torque [N m],eta [%]"]
    for i in range(6):
        lines.append(f"2026-03-0{1 + i // 2},{i // 3},{10 * i - 20},1500,{200 + i},75")
    table = tmp_path / "table.csv"
    table.write_text("\n".join(lines) + "\n")
    out = tmp_path / "bench.csv"
    options = () if own_column else ("--session", name)
    done = hmcvt("import", table, "--out", out, "--yes", *options)
    assert done.code == 0, done.err
    assert read_bench(out).extra["session"] == ("0", "0", "0", "1", "1", "1")
    assert "as a session" not in done.out
