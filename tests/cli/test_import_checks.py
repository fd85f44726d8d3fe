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
