# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Forms that public test data takes (the numbers are our own): the right values, or the cause."""

import re
import shlex

import numpy as np
import pytest

import hmcvt_core as core
from hmcvt_core.files.units import read_unit
from hmcvt_core.model.engine import load_engine

RPM = np.pi / 30.0
HEAD = "stroke [%],n_engine [rpm],load torque [N m],eta [%]"
ROWS = ((10, 1500, 150.5, 70.5), (20, 1600, 210.0, 72.25), (-30, 1900, 95.5, 64.0))
"""Stroke in per cent, engine speed in r/min, load torque in N m and efficiency in per cent."""


def lines(rows, between=","):
    return "\n".join(between.join(map(str, row)) for row in rows) + "\n"


def imported(hmcvt, folder, data, *options, name="t.csv"):
    """The result of `hmcvt import` and the bench table, None when none was written."""
    raw, out = folder / name, folder / "bench.csv"
    raw.write_bytes(data if isinstance(data, bytes) else data.encode())
    out.unlink(missing_ok=True)
    done = hmcvt("import", raw, "--out", out, "--yes", *options)
    assert out.exists() == (done.code == 0), done
    return done, core.read_bench(out) if out.exists() else None


def agrees(found, rows=ROWS):
    stroke, speed, torque, efficiency = np.transpose(rows)[:5]
    np.testing.assert_allclose(found.displacement_ratio, stroke / 100.0)
    np.testing.assert_allclose(found.engine_speed, speed * RPM)
    np.testing.assert_allclose(found.load_torque, torque)
    np.testing.assert_allclose(found.efficiency, efficiency / 100.0)


def test_units_above_the_names_and_logger_channels(hmcvt, tmp_path):
    head = '"CH=1 stroke","CH=2 n_engine","CH=3 load torque","CH=4 eta"\n'
    done, found = imported(hmcvt, tmp_path, "%,rpm,N m,%\n" + head + lines(ROWS))
    assert done.code == 0, done
    agrees(found)


def test_message_names_before_a_signal(hmcvt, tmp_path):
    head = "CAN1.A.stroke [%],CAN1.EEC1.n_engine [rpm],M.load torque [N m],X.eta [%]\n"
    done, found = imported(hmcvt, tmp_path, head + lines(ROWS))
    assert done.code == 0, done
    agrees(found)


@pytest.mark.parametrize("end", ["\r", "\r\r\n"])
def test_lone_returns_end_lines(hmcvt, tmp_path, end):
    text = HEAD + "\r\n" + lines(ROWS).replace("\n", end)
    done, found = imported(hmcvt, tmp_path, text.encode())
    assert done.code == 0, done
    agrees(found)


def labview(segments, units=("%", "rpm", "Nm", "%")):
    parts = [
        "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
        "Multi_Headings\tYes\nX_Columns\tOne\nTime_Pref\tAbsolute\n***End_of_Header***\t\n"
    ]
    for names, rows in segments:
        parts.append(
            "\nChannels\t4\nSamples\t1\t1\t1\t1\n"
            + "\t".join(("Y_Unit_Label", *units))
            + "\nX_Dimension\tTime\tTime\tTime\tTime\n***End_of_Header***\n"
            + "\t".join(("X_Value", *names, "Comment"))
            + "\n"
            + lines(rows, "\t")
        )
    return "".join(parts)


NAMES = ("stroke", "n_engine", "load torque", "eta")


def test_labview_segments_with_units_in_their_keys(hmcvt, tmp_path):
    """Each segment is one test an hour after the last, with its keys before it."""
    timed = [(3600.0 * i, *row) for i, row in enumerate(ROWS)]
    text = labview([(NAMES, [row]) for row in timed])
    done, found = imported(hmcvt, tmp_path, text, name="t.lvm")
    assert done.code == 0, done
    agrees(found)


def test_labview_segments_of_other_channels_are_refused(hmcvt, tmp_path):
    other = ("stroke", "n_engine", "oil temperature", "eta")
    text = labview([(NAMES, [(0.0, *ROWS[0])]), (other, [(3600.0, *ROWS[1])])])
    done, _ = imported(hmcvt, tmp_path, text, name="t.lvm")
    assert done.code == 2 and "channels" in done.err, done


def test_a_column_without_a_name_and_mixed_percent(hmcvt, tmp_path):
    text = (
        "stroke [%],n_engine [rpm],load torque [N m],\n"
        "10,1500,150.5,0.705\n20,1600,210,72.25 %\n-30,1900,95.5,0.64\n"
    )
    done, _ = imported(hmcvt, tmp_path, text)
    assert done.code == 2 and "--efficiency unnamed" in done.err, done
    done, found = imported(hmcvt, tmp_path, text, "--efficiency", "unnamed")
    assert done.code == 0, done
    agrees(found)


def test_names_of_a_table_without_a_header(hmcvt, tmp_path):
    done, _ = imported(hmcvt, tmp_path, lines(ROWS))
    assert done.code == 2 and "--names" in done.err, done
    saved = tmp_path / "m.yaml"
    options = ("--names", HEAD, "--save-mapping", saved)
    done, found = imported(hmcvt, tmp_path, lines(ROWS), *options)
    assert done.code == 0, done
    agrees(found)
    done, again = imported(hmcvt, tmp_path, lines(ROWS), "--mapping", saved)
    assert done.code == 0, done
    agrees(again)


def test_names_in_another_number_than_the_columns(hmcvt, tmp_path):
    done, _ = imported(hmcvt, tmp_path, lines(ROWS), "--names", "n [rpm],eta [%]")
    assert done.code == 2 and "no row has 2 cells" in done.err, done


def test_a_matrix_is_named_as_one(hmcvt, tmp_path):
    text = "rpm,100,200,300,400\n" + lines(
        [(n, 80.5, 81.5, 82.5, 83.5) for n in (1000, 1500, 2000, 2500)]
    )
    done, _ = imported(hmcvt, tmp_path, text)
    assert done.code == 2 and "one row for each of its points" in done.err, done


@pytest.mark.parametrize("ramp", [False, True])
def test_a_grid_of_many_rows_is_no_recording(hmcvt, tmp_path, ramp):
    """At each speed the load goes up anew; a ramp at one speed after the other is a log."""
    points = 200 if ramp else 40
    rows = [
        (10, n, round(20.0 + 80.0 * i / points, 3), 70.0 + 0.001 * n)
        for n in (1000, 1200, 1400, 1600)
        for i in range(points)
    ]
    done, found = imported(hmcvt, tmp_path, f"{HEAD}\n" + lines(rows))
    if ramp:
        assert done.code == 2 and "--averaged" in done.err, done
    else:
        assert done.code == 0, done
        agrees(found, rows)


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("load torque [%]", "percent"),
        ("load torque (pct)", "percent"),
        ("Last-Drehmoment in Prozent", "percent"),
    ],
)
def test_a_torque_in_percent_is_no_torque(hmcvt, tmp_path, name, word):
    text = f"stroke [%],n_engine [rpm],{name},eta [%]\n" + lines(ROWS)
    done, _ = imported(hmcvt, tmp_path, text)
    assert done.code == 2 and word in done.err, done


@pytest.mark.parametrize(
    "name",
    [
        "motor position [rev]",
        "vehicle speed [mph]",
        "PA_PAC_3V3A [W]",
        "Servo 1 (µs)",
    ],
)
def test_names_that_once_were_taken_for_a_quantity(hmcvt, tmp_path, name):
    """A position in turns, a road's speed, a letter in a code, a width of pulses."""
    rows = [(*row, 1900.0 + 7.0 * i) for i, row in enumerate(ROWS)]
    done, found = imported(hmcvt, tmp_path, f"{HEAD},{name}\n" + lines(rows))
    assert done.code == 0, done
    agrees(found)
    assert found.stamp is None or not np.isfinite(found.stamp).any()

    side = f"stroke [%],{name},load torque [N m],eta [%]\n" + lines(ROWS)
    done, _ = imported(hmcvt, tmp_path, side)
    assert done.code == 2 and "engine_speed" in done.err, done


def test_what_is_missing_is_said_beside_the_question(hmcvt, tmp_path):
    text = (
        "stroke [%],n1 [rpm],n2 [rpm],p [bar]\n10,1500,1400,90.5\n20,1600,1450,99.5\n"
    )
    done, _ = imported(hmcvt, tmp_path, text)
    assert done.code == 2 and "which side" in done.err, done
    assert "besides, no column is named for" in done.err, done


# ---- unit tables ----------------------------------------------------------------------

VOLUME = 56.0e-6
"""Swept volume of a turn in m3 of the machine of these tables."""


def unit_rows():
    """Rows as a maker prints them, the displacement times the stroke, all without a unit."""
    for n in (800.0, 1600.0, 2400.0):
        for mpa in (8.0, 16.0, 24.0, 32.0):
            for stroke in (0.5, 1.0):
                volumetric = 1.0 - 0.0015 * mpa / stroke * 1600.0 / n
                mechanical = 0.98 - 0.00002 * n - 0.04 / mpa / stroke
                flow = 6e4 * stroke * VOLUME * n / 60.0 * volumetric
                torque = stroke * VOLUME * mpa * 1e6 / (2.0 * np.pi) / mechanical
                yield (
                    *(n, mpa, 1e6 * stroke * VOLUME, round(flow, 4), round(torque, 4)),
                    *(round(100.0 * volumetric, 5), round(100.0 * mechanical, 5)),
                )


UNIT_HEAD = "Speed,Pressure,Displacement,Qout,Torque,etav,etam\n"


def test_a_unit_table_without_units(hmcvt, tmp_path):
    path = tmp_path / "unit.csv"
    rows = list(unit_rows())
    path.write_text(UNIT_HEAD + lines(rows))
    done = hmcvt("unit", path, "--kind", "pump")
    assert done.code == 2, done
    proposed = re.search(r"--displacement \S+", done.err)
    assert proposed and "56" in proposed[0], done
    found = read_unit(path, kind="pump", displacement="56:cm3")
    n, mpa, volume, flow, torque = np.transpose(rows)[:5]
    np.testing.assert_allclose(found.speed, n * RPM)
    np.testing.assert_allclose(found.pressure, mpa * 1e6)
    np.testing.assert_allclose(found.displacement_ratio, volume / 56.0)
    assert found.displacement == pytest.approx(VOLUME / (2.0 * np.pi))
    ideal = volume * 1e-6 * n / 60.0
    np.testing.assert_allclose(found.flow_loss, ideal - flow / 6e4, atol=2e-7)
    lost = torque - volume * mpa / (2.0 * np.pi)
    np.testing.assert_allclose(found.torque_loss, lost, atol=0.05)
    assert any("MPa" in note for note in found.notes), found.notes


def test_units_on_which_nothing_agrees_are_not_guessed(tmp_path):
    rows = [(n, p, v, 3.7 * q, t, a, b) for n, p, v, q, t, a, b in unit_rows()]
    path = tmp_path / "unit.csv"
    path.write_text(UNIT_HEAD + lines(rows))
    with pytest.raises(core.InputError):
        read_unit(path, kind="pump", displacement="56:cm3")


# ---- engine maps ----------------------------------------------------------------------


def engine_table(head, more=()):
    rows = [
        (n, torque, round(0.21 * torque * n * RPM, 3))  # 210 g/kWh
        for n in (800.0, 1200.0, 1600.0, 2000.0)
        for torque in (100.0, 200.0, 400.0, 600.0)
    ]
    return head + "\n" + lines([*rows, *more])


@pytest.mark.parametrize(
    "head",
    [
        "engine speed [rpm],torque [Nm],fuel consumption [g/h]",
        "rpm [1/min],engine torque [Nm],FC [g/h]",
        "Drehzahl [1/min],Drehmoment [Nm],Verbrauch [g/h]",
    ],
)
def test_an_engine_map_under_other_names(tmp_path, head):
    plain, other = tmp_path / "plain.csv", tmp_path / "other.csv"
    plain.write_text(engine_table("engine_speed [r/min],torque [N m],fuel [g/h]"))
    motoring = [(n, -90.0, 0.0) for n in (800.0, 2000.0)]
    other.write_text(engine_table(head, motoring))
    for quantity in ("speed", "full_load", "load", "fuel"):
        found = (getattr(load_engine(table), quantity) for table in (other, plain))
        np.testing.assert_array_equal(*found)


def test_two_torques_of_an_engine_map_are_refused(tmp_path):
    path = tmp_path / "e.csv"
    text = engine_table("engine speed [rpm],engine torque [Nm],fuel used [g/h]")
    head, *rows = text.splitlines()
    path.write_text("\n".join([head + ",Torque (Nm)", *(row + ",700" for row in rows)]))
    with pytest.raises(core.InputError, match="both name torque"):
        load_engine(path)


def test_what_the_refusal_of_names_proposes_is_taken(hmcvt, tmp_path):
    rows = [row[1:] for row in ROWS]
    done, _ = imported(hmcvt, tmp_path, lines(rows), "--displacement-ratio", "0.5")
    proposed = re.search(r"--names '[^']+'", done.err)
    assert done.code == 2 and proposed, done
    assert shlex.split(proposed[0])[1].count(",") == 2, proposed
