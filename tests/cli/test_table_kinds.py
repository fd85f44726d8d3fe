# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Tables that were once read wrong without a word: the right values, or the true cause."""

import shlex
from pathlib import Path

import numpy as np
import pytest

import hmcvt_core as core

FOLDER = Path(__file__).resolve().parents[1] / "data" / "tables"
FIRST = [-0.7944, 122.2, 177.3, 0.708]
"""Stroke, engine speed, load torque and efficiency of the first test of these files."""


def columns(samples):
    return np.transpose(
        [
            samples.displacement_ratio,
            samples.engine_speed,
            samples.load_torque,
            samples.efficiency,
        ]
    )


@pytest.mark.parametrize(
    ("name", "tests"),
    [
        ("first_test_lost_in_header/chinese.csv", 12),
        ("first_test_lost_in_header/m_is_test_number.csv", 12),
        ("lvm_comment_column/bench.lvm", 12),
        ("message_no_column_is_named/fortran.csv", 6),
        ("message_no_column_is_named/pipe.csv", 6),
        ("t_taken_for_torque/n_T_M_eta.csv", 12),
        ("t_taken_for_torque/t_minutes.csv", 12),
        ("unit_row_eats_side/asammdf_like.csv", 12),
        ("unit_row_eats_side/german.csv", 12),
        ("unit_row_eats_side/n_out_first.csv", 12),
    ],
)
def test_every_test_arrives_with_its_values(hmcvt, tmp_path, name, tests):
    out = tmp_path / "bench.csv"
    done = hmcvt("import", FOLDER / name, "--out", out, "--yes")
    assert done.code == 0, done
    found = core.read_bench(out)
    assert len(found) == tests
    assert columns(found)[0] == pytest.approx(FIRST, rel=1e-3)


def test_thousands_of_a_table_with_decimal_commas(hmcvt, tmp_path):
    folder = FOLDER / "german_thousands_all_above_999"
    out = tmp_path / "bench.csv"
    assert hmcvt("import", folder / "raw.csv", "--out", out, "--yes").code == 0
    found = core.read_bench(out)
    assert (found.load_torque.min(), found.load_torque.max()) == (1050.0, 1721.0)
    assert found.pressure.max() == pytest.approx(2.9407e7)
    with pytest.raises(core.InputError, match=r"load_torque '1.050'"):
        core.read_bench(folder / "bench.csv")


def test_the_unit_of_the_header_holds_for_a_named_column(hmcvt, tmp_path):
    path = FOLDER / "named_column_unit_in_header_ignored" / "us.csv"
    out = tmp_path / "bench.csv"
    named = (
        *("--engine-torque", "engine torque [lb ft]"),
        *("--output-torque", "output torque [lb ft]"),
        *("--oil-temperature", "oil temp [deg F]"),
    )
    for options in (named, ()):
        assert hmcvt("import", path, "--out", out, "--yes", *options).code == 0
        found = core.read_bench(out)
        assert columns(found)[0] == pytest.approx(FIRST, rel=1e-3)
        assert found.oil_temperature[0] == pytest.approx(60.0)


@pytest.mark.parametrize(
    "path",
    sorted((FOLDER / "recording_stamp_not_read").iterdir()),
    ids=lambda p: p.stem,
)
def test_stamps_of_any_form_make_a_recording(hmcvt, tmp_path, path):
    out = tmp_path / "bench.csv"
    done = hmcvt("import", path, "--out", out, "--yes")
    assert done.code == 0 and "cut into 3 steady windows" in done.out, done
    found = core.read_bench(out)
    assert columns(found)[0] == pytest.approx(FIRST, rel=2e-3)


def test_signals_of_one_row_each_are_joined(hmcvt, tmp_path):
    path = FOLDER / "recording_one_signal_a_row" / "async.csv"
    out = tmp_path / "bench.csv"
    assert hmcvt("import", path, "--out", out, "--yes").code == 0
    assert columns(core.read_bench(out))[0] == pytest.approx(FIRST, rel=2e-3)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("decimal_comma_in_comma_csv.csv", ("row 2: 13 fields", "engine torque [Nm]")),
        ("us_thousands.csv", ("'30,611'", "engine power [W]", "--decimal point")),
    ],
)
def test_the_true_cause_is_named(hmcvt, tmp_path, name, words):
    path = FOLDER / "message_no_column_is_named" / name
    done = hmcvt("import", path, "--out", tmp_path / "bench.csv", "--yes")
    assert done.code == 2
    for word in words:
        assert word in done.err


def test_a_decimal_sign_answers(hmcvt, tmp_path):
    path = FOLDER / "message_no_column_is_named" / "us_thousands.csv"
    out = tmp_path / "bench.csv"
    done = hmcvt("import", path, "--out", out, "--yes", "--decimal", "point")
    assert done.code == 0, done
    assert core.read_bench(out).engine_speed[0] == pytest.approx(2167 * np.pi / 30)


@pytest.mark.parametrize(
    ("header", "word"),
    [
        ("stroke [%],n [rpm],n [rpm],M [Nm],eta [%]", "does not|do not say which side"),
        ("stroke [%],n 1 [rpm],n 2 [rpm],M_load [Nm],eta [%]", "which side"),
        ("stroke [%],engine speed [foo],x,load torque [Nm],eta [%]", "foo"),
        (
            "stroke [%],engine speed [rpm],input speed [rpm],load torque [Nm],eta",
            "both",
        ),
        ("stroke [%],fan speed [rpm],x,load torque [Nm],eta [%]", "engine_speed"),
    ],
)
def test_what_a_header_leaves_open_is_asked(hmcvt, tmp_path, header, word):
    path = tmp_path / "t.csv"
    rows = "10.5,1400,1300,200,80.5\n-20.5,1500,1310,210,81.5\n"
    path.write_text(f"{header}\n{rows}")
    out = tmp_path / "bench.csv"
    done = hmcvt("import", path, "--out", out, "--yes")
    assert done.code == 2 and not out.exists(), done
    assert any(part in done.err for part in word.split("|")), done.err


def test_units_that_contradict_are_a_suspicion(hmcvt, tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(
        "stroke [%],engine speed [rpm],engine torque [Nm],output speed [rpm],"
        "output torque [lb ft],efficiency [%]\n"
        "10.5,1400,200,1500,149.3,80\n-20.5,1500,200,1500,160,80\n"
    )
    out = tmp_path / "bench.csv"
    done = hmcvt("import", path, "--out", out, "--yes")
    assert done.code == 2 and "lb ft and N m mixed up" in done.err
    assert hmcvt("import", path, "--out", out, "--yes", "--unchecked").code == 0


def test_a_mapping_makes_the_answer_last(hmcvt, tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(
        "hub,n1,n2,M [Nm],eta\n0.5,1400,1500,200,0.8\n0.2,1500,1600,210,0.8\n"
    )
    saved = tmp_path / "m.yaml"
    out = tmp_path / "bench.csv"
    named = ("--engine-speed", "n1:rpm", "--load-torque", "M [Nm]")
    done = hmcvt("import", path, "--out", out, "--yes", "--save-mapping", saved, *named)
    assert done.code == 0, done
    first = out.read_text()
    out.unlink()
    again = hmcvt("import", path, "--out", out, "--mapping", saved)
    assert again.code == 0 and out.read_text() == first, again


@pytest.mark.parametrize(
    ("start", "word"),
    [
        (b"PAR1", "Parquet"),
        (b"MDF 4.10", "asammdf"),
        (b"TDSm", "npTDMS"),
        (b"LOGG", "BLF"),
    ],
)
def test_binary_files_are_named(hmcvt, tmp_path, start, word):
    path = tmp_path / "log.dat"
    path.write_bytes(start + bytes(range(64)))
    done = hmcvt("import", path, "--out", tmp_path / "bench.csv")
    assert done.code == 2 and word in done.err


def test_days_and_months_that_can_be_exchanged_are_asked(hmcvt, tmp_path):
    path = FOLDER / "recording_stamp_not_read" / "us_24h.csv"
    text = path.read_text().replace("04/23/2024", "04/03/2024")
    path = tmp_path / "t.csv"
    path.write_text(text)
    out = tmp_path / "bench.csv"
    done = hmcvt("import", path, "--out", out, "--yes")
    assert done.code == 2 and "--stamp Time:dmy or --stamp Time:mdy" in done.err
    answer = shlex.split("--stamp Time:mdy")
    assert hmcvt("import", path, "--out", out, "--yes", *answer).code == 0


def test_text_in_a_column_of_time_is_refused(hmcvt, tmp_path):
    path = FOLDER / "recording_stamp_not_read" / "read_iso.csv"
    text = path.read_text().replace("2024-04-23T", "day 5 at ")
    path = tmp_path / "t.csv"
    path.write_text(text)
    done = hmcvt("import", path, "--out", tmp_path / "bench.csv", "--yes")
    assert (
        done.code == 2
        and "'day 5 at 10:59:50.000' cannot be read as a time" in done.err
    )


def test_one_quantity_in_two_units_is_no_question(hmcvt, tmp_path):
    raw = tmp_path / "raw.csv"
    out = tmp_path / "bench.csv"
    rows = ["stroke [%],eps [-],n_engine [rpm],load torque [N m],eta [-]"]
    for percent, fraction in ((-73, -0.73), (20, 0.2), (90, 0.9)):
        rows.append(f"{percent},{fraction},1500,150.0,0.7")
    raw.write_text("\n".join(rows))
    assert hmcvt("import", raw, "--out", out, "--yes").code == 0
    assert core.read_bench(out).displacement_ratio.tolist() == [-0.73, 0.2, 0.9]

    raw.write_text("\n".join([*rows[:-1], "90,0.8,1500,150.0,0.7"]))
    done = hmcvt("import", raw, "--out", out, "--yes")
    assert done.code == 2 and "both name displacement ratio" in done.err


def test_an_assumed_unit_of_torque_is_said(hmcvt, tmp_path):
    raw = tmp_path / "raw.csv"
    out = tmp_path / "bench.csv"
    rows = "-73,1500,1400,150.5,120.5\n20,1500,1500,152.5,121.5\n"
    raw.write_text(f"stroke [%],n_engine,n_out,M_engine,M_out\n{rows}")
    done = hmcvt("import", raw, "--out", out, "--yes")
    assert done.code == 0
    for name in ("M_engine", "M_out"):
        assert f"unit assumed: N m (column '{name}' names none)" in done.out
    stated = ("--engine-torque", "M_engine:N m", "--output-torque", "M_out:lb ft")
    done = hmcvt("import", raw, "--out", out, "--yes", *stated, "--unchecked")
    assert "unit assumed" not in done.out

    raw.write_text(f"stroke [%],n_engine,n_out,M_engine [Nm],M_out [Nm]\n{rows}")
    assert "unit assumed" not in hmcvt("import", raw, "--out", out, "--yes").out


@pytest.mark.parametrize("split", [False, True])
def test_columns_of_date_and_of_time_are_one_stamp(hmcvt, tmp_path, split):
    raw = tmp_path / "raw.csv"
    out = tmp_path / "bench.csv"
    rows = ["Date,Time,stroke [%],n_engine [rpm],load torque [N m],eta [%]"]
    tests = (("26.11.2026", "23:50:00"), ("27.11.2026", "00:10:30"))
    for number, (day, clock) in enumerate((*tests, ("30.11.2026", "08:00:00"))):
        rows.append(f"{day},{clock},{10 * number},1500,150.5,70.5")
    raw.write_text("\n".join(rows))
    options = ("--stamp", "Date Time") if split else ()
    done = hmcvt("import", raw, "--out", out, "--yes", *options)
    assert done.code == 0, done.err
    stamps = core.read_bench(out).stamp
    assert np.diff(stamps) == pytest.approx([1230.0, 3 * 86400.0 + 28170.0])


def test_a_date_beside_a_clock_is_asked_for_its_order(hmcvt, tmp_path):
    raw = tmp_path / "raw.csv"
    raw.write_text(
        "Date,Time,stroke [%],n_engine [rpm],load torque [N m],eta [%]\n"
        "03/04/2026,12:00:00,10,1500,150.5,70.5\n"
        "05/04/2026,12:00:00,20,1500,150.5,70.5\n"
    )
    done = hmcvt("import", raw, "--out", tmp_path / "bench.csv", "--yes")
    assert done.code == 2 and "--stamp 'Date Time:dmy'" in done.err
