# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Forms that public test data takes (the numbers are our own): the right values, or the cause."""

import re
import shlex

import numpy as np
import pytest

import hmcvt_core as core
from hmcvt_core.model.engine import load_engine
from hmcvt_tools.tables.unit_table import read_unit

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


# ---- maps of machines -----------------------------------------------------------------

ONE = ("--displacement-ratio", "1")
SPEEDS = (0, 600, 1200, 1800, 2400, 3600)
TORQUES = (-100, -50, 0, 50, 100, 200, 400)
"""Settings of a map in r/min and N m: standstill, overrun, no load, and beyond a tractor."""


def part(speed, torque):
    """An efficiency in per cent."""
    return round(95.0 - 0.002 * speed - 400.0 / (abs(torque) + 40.0), 2)


def points_of_map(speeds=SPEEDS, torques=TORQUES):
    return [
        (100, n, torque, part(n, torque))
        for n in speeds
        for torque in torques
        if 0 < n < 3000 and torque > 0
    ]


def ordered(found):
    """Bench samples in order of speed and torque."""
    return found.select(np.lexsort((found.load_torque, found.engine_speed)))


def test_rows_of_a_map_without_power_are_left_out(hmcvt, tmp_path):
    rows = [(n, torque, part(n, torque)) for n in SPEEDS for torque in TORQUES]
    text = "Speed [rpm],Torque [Nm],Efficiency [%]\n" + lines(rows)
    done, found = imported(hmcvt, tmp_path, text, *ONE)
    assert done.code == 0, done
    agrees(found, points_of_map())
    for word in ("about 0", "negative", "goes on beyond 10 to 320 rad/s"):
        assert word in done.out, done


def test_one_odd_row_of_a_map_is_still_asked(hmcvt, tmp_path):
    rows = [(n, torque, part(n, torque)) for n in SPEEDS[1:5] for torque in TORQUES[3:]]
    for place, odd in ((1, -100), (0, 6000)):
        mistyped = [list(row) for row in rows]
        mistyped[7][place] = odd
        text = "Speed [rpm],Torque [Nm],Efficiency [%]\n" + lines(mistyped)
        done, _ = imported(hmcvt, tmp_path, text, *ONE)
        assert done.code == 2 and "row 9" in done.err, done


def test_a_map_that_goes_on_beyond_a_tractor(hmcvt, tmp_path):
    """Digitised points share no settings; faster ones are left out where no gap is below them."""
    rows = [
        (400 + 130 * i, 40 + 7 * (i % 9), round(80 + 0.1 * i, 2)) for i in range(30)
    ]
    text = "Speed [rpm],Torque [Nm],Efficiency [%]\n"
    done, found = imported(hmcvt, tmp_path, text + lines(rows), *ONE)
    assert done.code == 0 and "goes on beyond" in done.out, done
    agrees(found, [(100, *row) for row in rows if row[0] < 3050])
    kept = [row for row in rows if row[0] < 2900]
    for others in ([15000], [3200], [9000, 9100, 9200], [22000, 23000, 24000]):
        apart = [(n, 50, 85.0) for n in others]
        done, _ = imported(hmcvt, tmp_path, text + lines(kept + apart), *ONE)
        assert done.code == 2 and "row 22" in done.err, done


@pytest.mark.parametrize("name", ["motor_efficiency_map.csv", "motor.csv"])
def test_the_file_names_the_last_column_of_a_map(hmcvt, tmp_path, name):
    rows = [
        (n, torque, part(n, torque) / 100.0)
        for n in SPEEDS[1:5]
        for torque in TORQUES[3:]
    ]
    text = "RPM,Torque,\n" + lines(rows).replace("0.8821", "88.21%")
    done, found = imported(hmcvt, tmp_path, text, *ONE, name=name)
    if name == "motor.csv":
        assert done.code == 2 and "--efficiency unnamed" in done.err, done
        return
    assert done.code == 0, done
    agrees(found, points_of_map())
    more = "RPM,Torque,Voltage,\n" + lines([(*row[:2], 300.5, row[2]) for row in rows])
    done, _ = imported(hmcvt, tmp_path, more, *ONE, name=name)
    assert done.code == 2 and "--efficiency unnamed" in done.err, done


def test_torques_beyond_a_bench_are_refused_without_a_unit(hmcvt, tmp_path):
    """They may be in N cm; a setting is left out only where the table states its unit."""
    torques = (1000, 2000, 4000, 8000)
    rows = [(n, torque, part(n, torque)) for n in SPEEDS[1:5] for torque in torques]
    for head, code in (("Torque", 2), ("Torque [Nm]", 0)):
        text = f"Speed [rpm],{head},Efficiency [%]\n" + lines(rows)
        done, found = imported(hmcvt, tmp_path, text, *ONE)
        assert done.code == code, done
    assert found.load_torque.max() == 4000.0


def test_a_dead_meter_is_no_map_without_load(hmcvt, tmp_path):
    rows = [(n, 0, 80.5) for n in range(600, 2400, 100)] + [(2400, 90, 81.0)]
    text = "Speed [rpm],Torque [Nm],Efficiency [%]\n" + lines(rows)
    done, _ = imported(hmcvt, tmp_path, text, *ONE)
    assert done.code == 2 and "load_torque = 0" in done.err, done


LOSS_HEAD = "Input Speed [rpm],Input Torque [Nm],Torque Loss [Nm]"


def loss_rows():
    for n in (0, 100, 300, 500, 1500, 2500):
        for torque in (-300, -100, 5, 100, 300, 900):
            yield n, torque, round(8.5 + 0.02 * abs(torque) + 0.001 * n, 4)


def test_a_loss_map_of_a_gearbox(hmcvt, tmp_path):
    text = f"{LOSS_HEAD}\n" + lines(loss_rows())
    done, found = imported(hmcvt, tmp_path, text, *ONE, name="gear.vtlm")
    assert done.code == 0 and "engine torque - torque loss" in done.out, done
    assert "the loss takes the whole torque" in done.out, done
    used = [row for row in loss_rows() if row[0] > 0 and row[1] > 5]
    speed, torque, loss = np.transpose(used)
    np.testing.assert_allclose(found.engine_speed, speed * RPM)
    np.testing.assert_allclose(found.load_torque, torque - loss)
    np.testing.assert_allclose(found.efficiency, (torque - loss) / torque)


@pytest.mark.parametrize("right", [True, False])
def test_an_efficiency_next_to_a_loss_is_compared_with_it(hmcvt, tmp_path, right):
    rows = []
    for n, torque, loss in loss_rows():
        if n > 0 and torque > 5:
            stated = 1.0 - loss / torque if right else 0.6
            rows.append((n, torque, loss, round(stated, 5)))
    text = f"{LOSS_HEAD},Eff [-]\n" + lines(rows)
    done, _ = imported(hmcvt, tmp_path, text, *ONE)
    assert done.code == (0 if right else 2), done


def test_a_loss_of_a_table_with_both_shafts_is_not_used(hmcvt, tmp_path):
    head = "stroke [%],n_engine [rpm],M_engine [Nm],n_out [rpm],M_out [Nm],Torque loss [Nm]"
    rows = [
        (10, 1500, 100, 750, 160, 40),
        (20, 1600, 120, 800, 200, 40),
        (30, 1900, 140, 950, 230, 50),
    ]
    done, found = imported(hmcvt, tmp_path, f"{head}\n" + lines(rows))
    assert done.code == 0, done
    np.testing.assert_allclose(found.efficiency, [0.8, 200 / 240, 230 / 280])


CURVE = (
    "Speed (RPM),Torque (N\u00b7m),Supplied Power (W),Output Power (W),Efficiency (%)"
)


def curve_rows():
    """A computed curve in equal steps from standstill to no load, with small torques."""
    for step in range(101):
        n = 20.0 * step
        torque = 2.5 * (1.0 - step / 100.0)
        out = torque * n * RPM
        taken = 40.0 + 1.6 * out
        yield (
            n,
            round(torque, 6),
            round(taken, 3),
            round(out, 5),
            round(100 * out / taken, 4),
        )


def test_a_computed_curve_with_powers(hmcvt, tmp_path):
    text = f"{CURVE}\n" + lines(curve_rows())
    done, found = imported(hmcvt, tmp_path, text.encode("cp1252"), *ONE)
    assert done.code == 0 and "agrees with the load torque" in done.out, done
    assert "go in equal steps" in done.out, done
    used = [row for row in curve_rows() if row[0] * RPM > 10 and row[1] >= 1.0]
    speed, torque, _, _, efficiency = np.transpose(used)
    np.testing.assert_allclose(found.engine_speed, speed * RPM)
    np.testing.assert_allclose(found.load_torque, torque, rtol=1e-4)
    np.testing.assert_allclose(found.efficiency, efficiency / 100.0)


@pytest.mark.parametrize("noise", [0.0, 6.0])
def test_a_curve_in_steps_that_are_rounded(hmcvt, tmp_path, noise):
    """Speeds and torques in whole numbers; with the noise of a meter it may be a ramp."""
    scatter = noise * np.random.default_rng(5).standard_normal(120)
    rows = []
    for step in range(120):
        n = round(400.0 + 18.7 * step + scatter[step])
        torque = round(900.0 - 6.37 * step + scatter[step])
        rows.append((n, torque, round(85.0 + 0.05 * step, 2)))
    text = "Speed [rpm],Torque [Nm],Efficiency [%]\n" + lines(rows)
    done, found = imported(hmcvt, tmp_path, text, *ONE)
    if noise:
        assert done.code == 2 and "--averaged" in done.err, done
    else:
        assert done.code == 0 and "go in equal steps" in done.out, done
        agrees(found, [(100, *row) for row in rows])


def test_small_torques_that_nothing_confirms_are_suspected(hmcvt, tmp_path):
    rows = [(row[0], round(1.1 * row[1], 6), *row[2:]) for row in curve_rows()]
    done, _ = imported(hmcvt, tmp_path, f"{CURVE}\n" + lines(rows), *ONE)
    assert done.code == 2, done


# ---- matrices -------------------------------------------------------------------------

MAP_SPEEDS = (300, 900, 1500, 2100, 2700, 4200, 5700)
MAP_TORQUES = (20, 60, 100, 140, 180)


def matrix(corner, across=MAP_TORQUES, down=MAP_SPEEDS, of=part):
    head = ",".join(map(str, (corner, *across)))
    body = lines([(one, *(of(one, other) for other in across)) for one in down])
    return f"{head}\n{body}"


def of_exchanged(torque, speed):
    return part(speed, torque)


MATRIX_POINTS = points_of_map(MAP_SPEEDS, MAP_TORQUES)


@pytest.mark.parametrize(
    "text",
    [
        "Efficiency [%] (Speed (rpm) vs Torque (Nm))\n\n" + matrix(""),
        "Efficiency [%]\n" + matrix("rpm\\Nm"),
        "Wirkungsgrad [%]\n" + matrix("Drehzahl [1/min] / Drehmoment [Nm]"),
        "Efficiency [%]\n"
        + matrix("Torque [Nm] : Speed [rpm]", MAP_SPEEDS, MAP_TORQUES, of_exchanged),
    ],
)
def test_a_matrix_that_names_its_axes(hmcvt, tmp_path, text):
    done, found = imported(hmcvt, tmp_path, text, *ONE)
    assert done.code == 0 and "a matrix, with" in done.out, done
    agrees(ordered(found), MATRIX_POINTS)


def test_a_matrix_whose_file_names_the_cells(hmcvt, tmp_path):
    text = matrix("Speed : Torque").replace(str(part(300, 20)), "")
    done, found = imported(hmcvt, tmp_path, text, *ONE, name="motor_efficiency.csv")
    assert done.code == 0 and "the name of the file" in done.out, done
    assert "unit assumed: N m" in done.out and "unit assumed: rpm" in done.out, done
    assert "1 cells without a point left out" in done.out, done
    agrees(ordered(found), MATRIX_POINTS[1:])
    done, _ = imported(hmcvt, tmp_path, text, *ONE, name="motor.csv")
    assert done.code == 2 and "--matrix" in done.err, done


def test_the_names_of_a_matrix_as_given(hmcvt, tmp_path):
    names = ("--matrix", "speed [rpm],torque [Nm],efficiency [%]")
    saved = tmp_path / "m.yaml"
    text = matrix("map 7")
    done, found = imported(hmcvt, tmp_path, text, *ONE, *names, "--save-mapping", saved)
    assert done.code == 0, done
    agrees(ordered(found), MATRIX_POINTS)
    done, again = imported(hmcvt, tmp_path, text, "--mapping", saved)
    assert done.code == 0, done
    agrees(ordered(again), MATRIX_POINTS)
    done, _ = imported(hmcvt, tmp_path, text, *ONE, "--matrix", "speed [rpm]")
    assert done.code == 2 and "three names" in done.err, done
    done, _ = imported(hmcvt, tmp_path, HEAD + "\n" + lines(ROWS), *names)
    assert done.code == 2 and "no sheet holds a matrix" in done.err, done


def test_numbers_in_a_header_that_the_user_names(hmcvt, tmp_path):
    numbers = "test,11,12,13,14\n" + lines(
        [(i + 1, *row) for i, row in enumerate(ROWS)]
    )
    named = ("--displacement-ratio", "11:%", "--engine-speed", "12:rpm")
    named += ("--load-torque", "13", "--efficiency", "14:%")
    done, found = imported(hmcvt, tmp_path, numbers, *named)
    assert done.code == 0, done
    agrees(found)


def test_axes_that_may_be_exchanged_are_asked(hmcvt, tmp_path):
    """Both axes may be a speed in rad/s and a torque."""
    numbers = (80, 120, 160, 200)
    text = "Efficiency [%]\n" + matrix("Speed : Torque", numbers, numbers)
    done, _ = imported(hmcvt, tmp_path, text, *ONE)
    assert done.code == 2 and "--matrix" in done.err, done


@pytest.mark.parametrize("agreeing", [True, False])
def test_matrices_of_one_workbook_are_compared(hmcvt, tmp_path, agreeing):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    power, efficiency = book.active, book.create_sheet("efficiency")
    small = (10, 20, 30, 40, 50)
    axes = "(Speed (rad/s) vs Torque (Nm))"
    speeds = [round(n * RPM, 6) for n in MAP_SPEEDS]
    power.append([f"Input Power in W {axes}"])
    efficiency.append([f"Efficiency in Fraction {axes}"])
    for sheet in (power, efficiency):
        sheet.append(["", *small])
    for n, speed in zip(MAP_SPEEDS, speeds, strict=True):
        parts = [part(n, torque) / 100.0 for torque in small]
        scale = 1.0 if agreeing else 1.3
        taken = [
            scale * speed * torque / each
            for torque, each in zip(small, parts, strict=True)
        ]
        power.append([speed, *taken])
        efficiency.append([speed, *parts])
    path = tmp_path / "map.xlsx"
    book.save(path)
    done, found = imported(hmcvt, tmp_path, path.read_bytes(), *ONE, name="map.xlsx")
    if agreeing:
        assert done.code == 0 and "a matrix, with" in done.out, done
        found = ordered(found)
        speed, torque, stated = np.transpose(points_of_map(MAP_SPEEDS, small))[1:]
        np.testing.assert_allclose(found.engine_speed, speed * RPM, rtol=1e-6)
        np.testing.assert_allclose(found.load_torque, torque, rtol=1e-6)
        np.testing.assert_allclose(found.efficiency, stated / 100.0)
    else:
        assert done.code == 2, done


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


def test_the_kind_of_unit_follows_where_only_one_agrees(tmp_path):
    path = tmp_path / "unit.csv"
    path.write_text(UNIT_HEAD + lines(unit_rows()))
    found = read_unit(path, displacement="56:cm3")
    assert found.kind == "pump"
    assert any("taken as a pump" in note for note in found.notes), found.notes
    lossless = [
        (*row[:3], row[2] * row[0] / 1000.0, row[2] * row[1] / 2.0 / np.pi, 100, 100)
        for row in unit_rows()
    ]
    path.write_text(UNIT_HEAD + lines(lossless))
    with pytest.raises(core.InputError, match="kind is missing"):
        read_unit(path, displacement="56:cm3")


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
        "fc_spd_RPM,fc_trq_Nm,fc_fuel_g_h",
        "n_e [rpm],T [Nm],fuel used [g/h]",
        "Measured speed [rpm],mean torque [Nm],fuel rate [g/h]",
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


@pytest.mark.parametrize(
    "head",
    [
        "c engine speed,torque,fuel consumption\nc [rpm],[Nm],[g/h]",
        "Drehzahl,Drehmoment,Verbrauch\n1/min,Nm,g/h",
    ],
)
def test_an_engine_map_with_a_row_of_units(tmp_path, head):
    plain, other = tmp_path / "plain.csv", tmp_path / "other.vmap"
    plain.write_text(engine_table("engine_speed [r/min],torque [N m],fuel [g/h]"))
    other.write_text(engine_table(head))
    np.testing.assert_array_equal(load_engine(other).fuel, load_engine(plain).fuel)


def test_an_engine_map_of_specific_fuel_with_units_as_suffixes(tmp_path):
    """Without load the fuel per energy says nothing, whatever stands in its cells."""
    path = tmp_path / "e.csv"
    rows = [
        (n, torque, 999.0 if torque == 0 else 200.0 + 4000.0 / torque)
        for n in (800.0, 1600.0, 2000.0)
        for torque in (0.0, 100.0, 200.0, 400.0)
    ]
    path.write_text("speed,torque_Nm,bsfc_g_per_kWh\n" + lines(rows))
    with pytest.raises(core.InputError):
        load_engine(path)
    path.write_text("speed_rpm,torque_Nm,bsfc_g_per_kWh\n" + lines(rows))
    engine = load_engine(path)
    for n, torque, specific in rows:
        power = torque * n * RPM
        expected = specific * power / 3.6e9
        if torque == 0.0:
            expected = 4000.0 * n * RPM / 3.6e9  # Willans: the line through the others
        assert engine.fuel_rate(n * RPM, torque) == pytest.approx(expected)


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


@pytest.mark.parametrize("days", [0, 1, 3])
def test_dates_alone_do_not_make_tests_of_a_recording(hmcvt, tmp_path, days):
    turn = np.linspace(0.0, 2.0 * np.pi, 600)
    rows = zip(
        np.round(60.0 * np.sin(turn), 4),
        np.round(1500.0 + 300.0 * np.sin(1.3 * turn), 3),
        np.round(250.0 + 80.0 * np.cos(1.2 * turn), 4),
        np.round(75.0 + 5.0 * np.sin(0.9 * turn), 4),
        strict=True,
    )
    head = HEAD
    if days:
        head = f"Date,{HEAD}"
        rows = [
            (f"2026-03-{9 + i * days // 600:02d}", *row) for i, row in enumerate(rows)
        ]
    text = f"{head}\n" + lines(rows)
    done, _ = imported(hmcvt, tmp_path, text)
    assert done.code == 2 and "as a recording does" in done.err, done
    done, found = imported(hmcvt, tmp_path, text, "--averaged")
    assert done.code == 0 and len(found) == 600, done
