# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Tables as benches write them, of our own and from outside: one correction at most is needed."""

import re
import shlex
from datetime import datetime, timedelta
from typing import NamedTuple

import numpy as np
import pytest

import hmcvt_core as core
from hmcvt_core.transmission.ranges import RPM

from .running import HM4, assert_refused

TESTS = 14
rng = np.random.default_rng(5)
EPS = np.round(rng.uniform(-1.0, 1.0, TESTS), 2)
SPEED = np.round(rng.uniform(900.0, 2100.0, TESTS), 1)  # r/min
LOAD = np.round(rng.uniform(80.0, 350.0, TESTS), 1)
MODEL = core.load_model(HM4)
ETA = MODEL.efficiency(EPS, SPEED * RPM, LOAD)
OUT = MODEL.output_speed(EPS, SPEED * RPM, LOAD) / RPM
INTO, POWER = LOAD / ETA, LOAD * SPEED * RPM  # N m, W
TORQUE = LOAD * SPEED / OUT


class Case(NamedTuple):
    """A file, the correction it needs (words of the command line), rows that hold no test."""

    path: object
    correction: tuple = ()
    lost: tuple = ()


def german(number, digits=2):
    return f"{number:,.{digits}f}".replace(",", "_").replace(".", ",").replace("_", ".")


def lines(path, rows, mark, encoding="utf-8"):
    path.write_bytes(
        "\n".join(mark.join(map(str, row)) for row in rows).encode(encoding)
    )
    return path


def german_office(folder):
    """Titles, decimal commas and thousands, a row of units, n.a., and a line of means."""
    rows = [
        [
            german(100 * EPS[i], 0),
            german(SPEED[i], 1),
            german(INTO[i]),
            german(OUT[i], 1),
            german(TORQUE[i]),
            "65,5" if i != 4 else "n.a.",
        ]
        for i in range(TESTS)
    ]
    rows[2][2] = "n.a."
    head = [
        ["Prüfstand 3", "", "", "", "", ""],
        ["Datum: 21.11.2026", "", "", "", "", ""],
        [
            "Pumpenhub",
            "Motordrehzahl",
            "Motordrehmoment",
            "Abtriebsdrehzahl",
            "Abtriebsdrehmoment",
            "Öltemperatur",
        ],
        ["%", "1/min", "Nm", "1/min", "Nm", "°C"],
    ]
    mean = [
        "Mittelwert",
        german(SPEED.mean()),
        german(INTO.mean()),
        german(OUT.mean()),
        german(TORQUE.mean()),
        "65,5",
    ]
    return Case(
        lines(folder / "t.csv", [*head, *rows, mean], ";", "cp1252"), (), (2, 4)
    )


def excel_of_two_heads(folder):
    """Powers under joined cells on the second sheet, with an empty cell."""
    import openpyxl

    book = openpyxl.Workbook()
    book.active.append(["see the next sheet"])
    sheet = book.create_sheet("Messung")
    sheet.append(["Bench report", None, None, None, None])
    sheet.append(["Pump", "Engine", None, "Output", None])
    sheet.append(
        [
            "displacement [%]",
            "speed [min-1]",
            "power [kW]",
            "speed [min-1]",
            "power [kW]",
        ]
    )
    sheet.merge_cells("B2:C2")
    for i in range(TESTS):
        sheet.append(
            [
                100.0 * EPS[i],
                SPEED[i],
                POWER[i] / ETA[i] / 1e3 if i != 7 else None,
                OUT[i],
                POWER[i] / 1e3,
            ]
        )
    book.save(folder / "t.xlsx")
    return Case(folder / "t.xlsx", (), (7,))


def tabs_of_an_american(folder):
    """Sentinels, lb ft, deg F, psi, hp."""
    rows = [
        [
            i + 1,
            EPS[i],
            SPEED[i],
            f"{INTO[i] / 1.3558179:.4f}",
            f"{OUT[i]:.3f}",
            f"{TORQUE[i] / 1.3558179:.4f}",
            176,
            -9999 if i == 5 else 2000 + i,
        ]
        for i in range(TESTS)
    ]
    head = [
        "Test No",
        "Stroke Ratio",
        "Engine RPM",
        "Engine Torque (lb-ft)",
        "Output RPM",
        "Output Torque (lb-ft)",
        "Oil Temp (deg F)",
        "Delta P (psi)",
    ]
    return Case(lines(folder / "t.txt", [head, *rows], "\t"), (), (5,))


def aligned_text(folder):
    rows = [
        ["eps[-]", "n_eng[rpm]", "T_load[Nm]", "eta[%]"],
        *[[EPS[i], SPEED[i], LOAD[i], f"{100 * ETA[i]:.3f}"] for i in range(TESTS)],
    ]
    return Case(
        lines(
            folder / "t.dat", [[f"{cell!s:>12}" for cell in row] for row in rows], " "
        )
    )


def units_in_the_cells(folder):
    rows = [
        [
            "Swash position",
            "Input speed",
            "Input torque",
            "Output speed",
            "Output torque",
        ],
        *[
            [
                f"{100 * EPS[i]:.0f} %",
                f"{SPEED[i]} rpm",
                f"{INTO[i]:.3f} Nm",
                f"{OUT[i]:.2f} rpm",
                f"{TORQUE[i] / 1e3:.6f} kNm",
            ]
            for i in range(TESTS)
        ],
    ]
    return Case(lines(folder / "t.csv", rows, ","))


def english_thousands(folder):
    """Quoted numbers with commas between thousands, an efficiency, and a row said twice."""
    rows = [
        [f"{EPS[i]}", f'"{SPEED[i]:,.1f}"', f"{LOAD[i]:.1f}", f"{ETA[i]:.5f}"]
        for i in range(TESTS)
    ]
    rows.insert(4, rows[3])
    head = [
        "displacement ratio",
        "engine speed (r/min)",
        "load torque (N m)",
        "efficiency",
    ]
    return Case(lines(folder / "t.csv", [["# bench 2"], head, *rows], ","), (), ())


def french(folder):
    head = [
        "Cylindrée (%)",
        "Régime moteur (tr/min)",
        "Couple moteur (N.m)",
        "Vitesse sortie (tr/min)",
        "Couple sortie (N.m)",
    ]
    rows = [
        [
            german(100 * EPS[i], 0),
            german(SPEED[i], 1).replace(".", " "),
            german(INTO[i], 3),
            german(OUT[i], 2).replace(".", "\u202f"),
            german(TORQUE[i], 3),
        ]
        for i in range(TESTS)
    ]
    return Case(lines(folder / "t.csv", [head, *rows], ";"))


def greek_and_si(folder):
    head = ["ε", "ω_e / rad/s", "P_out / kW", "η", "T_oil / K", "remark"]
    rows = [
        [
            EPS[i],
            f"{SPEED[i] * RPM:.4f}",
            f"{POWER[i] / 1e3:.4f}",
            f"{ETA[i]:.5f}",
            338.15,
            "warm",
        ]
        for i in range(TESTS)
    ]
    return Case(lines(folder / "t.csv", [head, *rows], ","))


def torque_of_no_shaft(folder):
    """One torque that does not say of which shaft: the guess has to be corrected."""
    rows = [
        ["hub", "n_an [U/min]", "n_ab [U/min]", "M [Nm]", "Wirkungsgrad [%]"],
        *[
            [
                EPS[i],
                SPEED[i],
                f"{OUT[i]:.3f}",
                f"{TORQUE[i]:.3f}",
                f"{100 * ETA[i]:.3f}",
            ]
            for i in range(TESTS)
        ],
    ]
    return Case(lines(folder / "t.csv", rows, ","), ("--output-torque", "M [Nm]"))


def readings():
    """Stroke, speeds and torques of a log: plateaus of 80 rows, a ramp of 40 between them."""
    noise = np.random.default_rng(1)
    columns = np.column_stack([EPS, SPEED, INTO, OUT, TORQUE])
    for i in range(TESTS):
        after = columns[min(i + 1, TESTS - 1)]
        for k in range(120):
            part = max(0, k - 80) / 40
            now = columns[i] * (1 - part) + after * part
            now[1:] *= 1.0 + 1e-3 * noise.standard_normal(4)
            yield [f"{value:.4f}" for value in now]


def recording(folder, seconds=0.1):
    """Rows with dates, every tenth with the oil."""
    start = datetime(2026, 11, 21, 9, 30)
    rows = [
        [
            (start + timedelta(seconds=seconds * i)).isoformat(sep=" "),
            *row,
            "" if i % 10 else 80.0,
            150,
        ]
        for i, row in enumerate(readings())
    ]
    head = [
        "Timestamp",
        "pump_displacement",
        "n_engine_rpm",
        "M_engine_Nm",
        "n_out_rpm",
        "M_out_Nm",
        "Oil temp [°C]",
        "dp [bar]",
    ]
    return Case(lines(folder / "t.csv", [head, *rows], ","))


def motec_export(folder):
    """As MoTeC i2 exports a log: rows of keys, names, units and a blank row, all quoted."""
    keys = [
        ["Format", "MoTeC CSV File", "", "", "Workbook", ""],
        ["Venue", "Test bed", "", "", "Worksheet", ""],
        ["Device", "ADL"],
        ["Log Date", "21/11/2026", "", "", "Origin Time", "0", "s"],
        ["Sample Rate", "10.000", "Hz", "", "End Time", "168.000", "s"],
        [],
        [],
    ]
    names = [
        [
            "Time",
            "Pump Stroke",
            "Engine RPM",
            "Engine Torque",
            "Output Shaft Speed",
            "Output Shaft Torque",
            "Eng Oil Pres",
        ],
        ["s", "%", "rpm", "Nm", "rpm", "Nm", "kPa"],
        [],
    ]
    rows = [
        [f"{0.1 * i:.3f}", f"{100 * float(row[0]):.3f}", *row[1:], 400]
        for i, row in enumerate(readings())
    ]
    return Case(
        lines(
            folder / "t.csv",
            [[f'"{cell}"' for cell in row] for row in (*keys, *names, *rows)],
            ",",
        )
    )


CASES = [
    german_office,
    excel_of_two_heads,
    tabs_of_an_american,
    aligned_text,
    units_in_the_cells,
    english_thousands,
    french,
    greek_and_si,
    torque_of_no_shaft,
    recording,
    motec_export,
]

# From outside: numbers that others measured, under the heads that they wrote, cut short here.
PAPER = """Test No.\tDisplacement Ratio\t\
Angular Velocity of the Output Shaft of the Engine (rad/s)\tLoad Torque (N · m)\t\
Transmission Efficiency (%)
1\t-1\t78.54\t101.86\t64.3\n5\t-1\t146.61\t163.70\t58.8\n8\t0\t126.19\t340.76\t84.4"""
"""Table 2 of Cheng, Lu, Dai 2019, doi 10.1155/2019/2856908, CC BY 4.0."""
# An electric drive on a dynamometer: github.com/sbwcwso/MotorTestDataProcessAndPlot, 03 Eff/335V.
BENCH = """speed_step,test_m_t [s],SO_N_HM [1/min],STOP_T [s],SO_M_VM [Nm],N_HM [1/min],M_HM [Nm],\
N_VM [1/min],M_VM [Nm],M_HMmess [Nm],Torque Accuracy (%),U_DC [V],P_Mech_GLM [W],P_VES_GLM [W],\
ETA_SYS_Pst_GLM [%],T_MOTOR [°C],T_PEU [°C]
2,3.255,500,2680.765,5,499.9928,-5.442408,498.57,4.9775,5.442408,0.44,335.02,284.9,392.6,72.582,59,40
22,45.525,1000,4728.725,5,999.9978,-5.40594,1000.28,4.8325,5.40594,0.41,335.04,566.1,708.3,79.918,59,40
422,777.335,3500,15293.6,5,3499.9999,-5.57543,3499.42,5,5.57543,0.58,334.9,2042.7,2436.5,83.83,61,40"""
WORKED_OUT = """SO_N_HM [1/min],SO_M_VM [Nm],speed_step,N_HM [1/min],M_HMmess [Nm],PA1_P_1 [W],\
PA1_P_4 [W],PA1_PM [W],Eff_Sys_WT [%],Eff_Motor_PA [%],T_MOTOR [°C],T_Rotor [°C]
500.0,200.0,200.0,499.9916,202.25303,8405.19,14852.577,10588.986,71.293928,82.93189584,60.0,
500.0,320.0,476.0,500.0153,322.26819,15352.2,26359.837,16873.195,64.011,75.89512987,61.58,
1000.0,-290.0,540.0,999.9996,-267.75235,-6201.8,-21234.9,-28036.88,75.739251,86.88663238,59.685,"""


@pytest.mark.parametrize("make", CASES, ids=lambda make: make.__name__)
def test_a_messy_table_is_read_in_one_correction(hmcvt, tmp_path, make):
    if make is excel_of_two_heads:
        pytest.importorskip("pandas")
        pytest.importorskip("openpyxl")
    path, correction, lost = make(tmp_path)
    out = tmp_path / "bench.csv"
    shown = hmcvt("import", path, "--out", out, *correction)
    assert (shown.code, shown.err) == (0, "") and not out.exists(), shown
    assert "--yes takes the proposal" in shown.out
    assert re.search(r"column +unit +lowest +highest\n", shown.out)
    assert not re.search(r" range\n", shown.out.replace("the usual range", ""))
    skip = ("--skip-bad",) if "--skip-bad" in shown.out else ()
    done = hmcvt("import", path, "--out", out, "--yes", *correction, *skip)
    assert done.code == 0, done
    found = core.read_bench(out)
    kept = np.setdiff1d(np.arange(TESTS), lost)
    assert len(found) == len(kept)
    loose = (
        3e-3
        if "a recording of" in done.out
        else 2e-3
        if make is german_office
        else 3e-4
    )
    assert found.displacement_ratio == pytest.approx(EPS[kept], abs=0.006)
    assert found.engine_speed == pytest.approx(SPEED[kept] * RPM, rel=loose)
    assert found.load_torque == pytest.approx(LOAD[kept], rel=loose)
    assert found.efficiency == pytest.approx(ETA[kept], rel=loose)
    if found.oil_temperature is not None:
        assert np.all((found.oil_temperature > 60.0) & (found.oil_temperature < 85.0))
    # What it says is the same as the guess, said explicitly.
    said = re.search(r"the same as a command: hmcvt (.*)", shown.out)[1]
    out.unlink()
    again = hmcvt(*shlex.split(said), *skip)
    assert (
        again.code == 0 and f"{len(kept)} bench samples written to {out}" in again.out
    )
    assert core.read_bench(out).efficiency.tolist() == found.efficiency.tolist()
    # The steps, for `pytest -rP`.
    command = ["hmcvt", "import", path.name, "--out", "bench.csv", *correction]
    print(
        f"{shlex.join(command)}\n{shown.out}{shlex.join([*command, '--yes', *skip])}\n{done.out}"
    )


@pytest.mark.parametrize(
    ("text", "correction", "expected"),
    [
        (
            PAPER,
            (),
            [
                [-1, 78.54, 101.86, 0.643],
                [-1, 146.61, 163.7, 0.588],
                [0, 126.19, 340.76, 0.844],
            ],
        ),
        (
            BENCH,
            (
                *("--displacement-ratio", "1", "--engine-speed", "N_VM [1/min]"),
                *("--load-torque", "M_HMmess [Nm]"),
                *("--efficiency", "ETA_SYS_Pst_GLM [%]"),
            ),
            [
                [1, 498.57 * RPM, 5.442408, 0.72582],
                [1, 1000.28 * RPM, 5.40594, 0.79918],
            ],
        ),
        (
            WORKED_OUT,
            (
                *("--displacement-ratio", "100:%", "--engine-speed", "N_HM [1/min]"),
                *("--load-torque", "M_HMmess [Nm]", "--efficiency", "Eff_Sys_WT [%]"),
            ),
            [
                [1, 499.9916 * RPM, 202.25303, 0.71293928],
                [1, 500.0153 * RPM, 322.26819, 0.64011],
            ],
        ),
    ],
    ids=["paper", "bench", "worked_out"],
)
def test_a_table_from_outside(hmcvt, tmp_path, text, correction, expected):
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    out = tmp_path / "bench.csv"
    done = hmcvt(
        "import", tmp_path / "t.csv", "--out", out, "--yes", "--skip-bad", *correction
    )
    found = core.read_bench(out)
    columns = [
        found.displacement_ratio,
        found.engine_speed,
        found.load_torque,
        found.efficiency,
    ]
    assert np.transpose(columns) == pytest.approx(np.array(expected), rel=1e-9)
    assert (
        found.oil_temperature is None
    )  # those of motor and electronics are not the oil's
    assert len(done.out.split("left out: ")) - 1 == len(text.splitlines()) - 1 - len(
        expected
    )


def test_every_bad_row_is_told_at_once_and_none_is_left_out_unasked(hmcvt, tmp_path):
    path, out = german_office(tmp_path).path, tmp_path / "bench.csv"
    done = hmcvt("import", path, "--out", out, "--yes")
    assert done.code == 2 and not out.exists()
    error = done.err.splitlines()[-1]
    for word in (
        "3 rows cannot be used (--skip-bad leaves them out)",
        "row 7: Motordrehmoment 'n.a.' is not a number",
        "row 9: Öltemperatur 'n.a.'",
        "row 19: 'Mittelwert'",
    ):
        assert word in error, error


def test_a_recording_never_passes_as_tests_without_a_word(hmcvt, tmp_path):
    path, out = recording(tmp_path).path, tmp_path / "bench.csv"
    done = hmcvt("import", path, "--out", out, "--yes")
    assert (
        f"a recording of {120 * TESTS} rows was cut into {TESTS} steady windows"
        in done.out
    )
    assert hmcvt("import", path, "--out", out, "--yes", "--averaged").code == 0
    assert len(core.read_bench(out)) == 120 * TESTS


@pytest.mark.parametrize("seconds", [0.1, 1.0])
def test_a_recording_by_a_clock_of_whole_seconds_is_one(hmcvt, tmp_path, seconds):
    path, out = recording(tmp_path, seconds).path, tmp_path / "bench.csv"
    path.write_text(re.sub(r"(:\d\d)\.\d+", r"\1", path.read_text()))
    done = hmcvt("import", path, "--out", out, "--yes")
    assert "not averaged, left out: pressure\n" in done.out
    found = core.read_bench(out)
    assert found.efficiency == pytest.approx(ETA, rel=3e-3)
    assert found.oil_temperature == pytest.approx(80.0)
    assert np.diff(found.stamp)[:-1] == pytest.approx(120.0 * seconds)


def test_a_slow_output_is_in_the_unit_of_the_engine_and_a_mode_is_no_stage(
    hmcvt, tmp_path
):
    path, out = tmp_path / "t.csv", tmp_path / "bench.csv"
    path.write_text(
        "eps,engine speed,engine torque,output speed,output torque,mode\n"
        "0.5,1400,200,120,1900,auto\n-0.5,1500,180,150,1500,auto\n"
    )
    told = hmcvt(
        "import-csv", path, "--out", out, "--yes", "--json"
    ).json  # its older name
    assert (told["samples"], told["out"]) == (2, str(out))
    assert told["columns"]["displacement_ratio"] == {
        "unit": "-",
        "low": -0.5,
        "high": 0.5,
    }
    found = core.read_bench(out)
    assert found.output_speed == pytest.approx(np.array([120.0, 150.0]) * RPM)
    assert found.extra == {"mode": ("auto", "auto")} and found.points.stage is None


@pytest.mark.parametrize(
    ("header", "cells", "told"),
    [
        ("dp", ("250", "200"), None),
        ("dp [-]", ("250", "200"), None),
        ("dp", ("", "50 bar"), "bar"),
        ("boost pressure [bar]", ("25", "25"), None),
        ("Ladedruck [bar]", ("25", "25"), None),
        ("p_hp", ("250", "200"), None),
        ("Eng Oil Pres [kPa]", ("400", "400"), None),
        ("T_oil_k", ("350", "350"), "K"),
        ("Zeit [h]", ("09:30:00", "09:45:00"), "h"),
    ],
)
def test_what_no_unit_tells_is_not_guessed(hmcvt, tmp_path, header, cells, told):
    path, out = tmp_path / "t.csv", tmp_path / "bench.csv"
    path.write_text(
        f"eps,n,M,eta,{header}\n0.5,1400,200,80,{cells[0]}\n"
        f"-0.5,1500,180,80,{cells[1]}\n"
    )
    shown = hmcvt(
        "import", path, "--out", out, "--averaged", "--header-row", 1, "--skip-bad"
    ).out
    assert shown.count("range") == 4 and "eta:%" in shown
    said = re.search(r"the same as a command: (.*)", shown)[1]
    assert (f"{header}:{told}" in said) if told else (header not in said)
    assert "--header-row 1 --averaged --skip-bad\n" in shown
    if told == "h":
        assert hmcvt("import", path, "--out", out, "--yes").code == 0
        assert np.diff(core.read_bench(out).stamp) == 900.0


@pytest.mark.parametrize("unit", ["1/s", "s-1", "Hz"])
def test_turns_and_radians_are_not_mixed_up(hmcvt, tmp_path, unit):
    path = tmp_path / "t.csv"
    path.write_text(f"eps,n [{unit}],M,eta\n0.5,23,200,0.8\n")
    done = hmcvt("import", path, "--out", tmp_path / "bench.csv", "--yes")
    assert done.code == 2 and "may count radians or turns" in done.err


def test_what_is_no_table_is_told(hmcvt, tmp_path):
    out = tmp_path / "bench.csv"
    for name, text, words in (
        ("e.csv", "", "is empty"),
        ("w.csv", "a,b\n1,2\n", "no column"),
        ("x.xlsx", "no zip", "Excel"),
    ):
        (tmp_path / name).write_text(text)
        done = hmcvt("import", tmp_path / name, "--out", out)
        assert done.code == 2 and words in done.err.splitlines()[-1], done
    assert_refused(
        hmcvt(
            "import",
            tmp_path / "w.csv",
            "--out",
            out,
            "--sheet",
            "S",
            "--displacement-ratio",
            "a",
        ),
        "--sheet is for Excel",
    )
