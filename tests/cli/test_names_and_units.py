# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Names and units of tables in several languages, of cycles, engine maps and units."""

import click
import numpy as np
import pytest

import hmcvt_core as hmcvt
import hmcvt_tools
from hmcvt_core.errors import InputError
from hmcvt_tools.cli import quantities
from hmcvt_tools.mission.cycle import read_cycle
from hmcvt_tools.tables.rules import meaning_of

from .running import run

ROWS = (
    (-79.44, 1167.1, 250.46, 1046.0, 197.86),
    (-36.01, 1762.1, 191.49, 1870.5, 122.55),
)


def written(path, header, rows=ROWS, extra=()):
    lines = [";".join(header)]
    for row in rows:
        lines.append(";".join(str(cell) for cell in (*row, *extra)))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def imported(path):
    out = path.with_suffix(".out.csv")
    done = run("import", path, "--out", out, "--yes")
    assert done.code == 0, done.err
    return hmcvt.read_bench(out)


HEADERS = {
    "de": "Hub relativ [%];Motordrehzahl [1/min];Motordrehmoment [Nm];"
    "Abtriebsdrehzahl [1/min];Abtriebsmoment [Nm]",
    "es": "cilindrada relativa [%];velocidad motor [rpm];par motor [Nm];"
    "velocidad de salida [rpm];par de salida [Nm]",
    "it": "cilindrata relativa [%];giri motore [rpm];coppia motore [Nm];"
    "giri uscita [rpm];coppia uscita [Nm]",
    "fr": "cylindrée relative [%];régime moteur [tr/min];couple moteur [Nm];"
    "régime sortie [tr/min];couple sortie [Nm]",
    "en": "relative displacement [%];engine speed [rpm];engine torque [Nm];"
    "output speed [rpm];output torque [Nm]",
    "zh": "变量泵排量比 [%];发动机转速 [rpm];发动机扭矩 [Nm];输出转速 [rpm];输出扭矩 [Nm]",
}


@pytest.mark.parametrize("language", HEADERS)
def test_relative_displacement(tmp_path, language):
    path = written(tmp_path / "bench.csv", HEADERS[language].split(";"))
    np.testing.assert_allclose(imported(path).displacement_ratio, [-0.7944, -0.3601])


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("rel. Schwenkwinkel [%]", "displacement_ratio"),
        ("relatives F\u00f6rdervolumen [%]", "displacement_ratio"),
        ("taux de cylindr\u00e9e [%]", "displacement_ratio"),
        ("relaci\u00f3n de cilindrada [-]", "displacement_ratio"),
        ("inclinazione piatto [%]", "displacement_ratio"),
        ("\u659c\u76d8\u5f00\u5ea6 [%]", "displacement_ratio"),
        ("\u8f93\u5165\u7aef\u8f6c\u901f [rpm]", "engine_speed"),
        ("Gelenkwellendrehzahl [1/min]", "output_speed"),
        ("coppia in uscita [Nm]", "output_torque"),
        ("velocit\u00e0 in uscita [rpm]", "output_speed"),
        ("\u00d6lsumpftemperatur [\u00b0C]", "oil_temperature"),
        ("torque in [Nm]", "engine_torque"),
        ("Drehzahlverh\u00e4ltnis [-]", ""),
        ("rapport de vitesse [-]", ""),
        ("Drehmomentverh\u00e4ltnis [Nm]", ""),
    ],
)
def test_headings_of_reports(name, quantity):
    meaning = meaning_of(name)
    assert meaning.quantity == quantity
    assert not meaning.unknown


def test_columns_that_are_not_used_are_named(tmp_path):
    header = [*HEADERS["de"].split(";"), "Luftdruck [bar]", "Nr.", "Bemerkung"]
    path = written(tmp_path / "t.csv", header, extra=(24.0, 7, "warm"))
    done = run("import", path, "--out", tmp_path / "o.csv", "--yes")
    assert (
        "kept as they are, not used: 'Luftdruck [bar]', 'Nr.', 'Bemerkung'" in done.out
    )
    done = run("import", path, "--out", tmp_path / "o.csv", "--yes", "--session", "Nr.")
    assert "not used: 'Luftdruck [bar]', 'Bemerkung'" in done.out


def test_two_spellings_of_one_unit_agree():
    assert meaning_of("engine rpm", "1/min").problem == ""
    assert meaning_of("engine rpm", "deg/s").problem.startswith("the header says")


@pytest.mark.parametrize(
    ("unit", "size"), [("‰", 1e-3), ("ppm", 1e-6), ("promille", 1e-3), ("%", 1e-2)]
)
def test_parts_of_a_whole(tmp_path, unit, size):
    header = [*HEADERS["en"].split(";"), f"efficiency std [{unit}]"]
    reading = 0.004 / size
    path = written(tmp_path / "bench.csv", header, extra=(f"{reading:g}",))
    np.testing.assert_allclose(imported(path).efficiency_std, 0.004)


def test_a_stroke_per_mille(tmp_path):
    header = HEADERS["en"].replace("displacement [%]", "displacement [‰]").split(";")
    rows = [(10.0 * row[0], *row[1:]) for row in ROWS]
    path = written(tmp_path / "bench.csv", header, rows)
    np.testing.assert_allclose(imported(path).displacement_ratio, [-0.7944, -0.3601])


@pytest.mark.parametrize(
    "name",
    [
        "charge pressure [bar]",
        "chargepressure [bar]",
        "Speisedruck [bar]",
        "pression de gavage [bar]",
        "presión de carga [bar]",
        "补油压力 [bar]",
    ],
)
def test_charge_pressure_is_no_loop_pressure(name):
    assert meaning_of(name).quantity == "charge_pressure"


@pytest.mark.parametrize("name", ["boost pressure [bar]", "Ladedruck [bar]"])
def test_boost_of_an_engine_is_no_charge_pressure(name):
    assert meaning_of(name).quantity == ""


def test_a_sign_in_brackets_that_is_no_unit_is_asked(tmp_path):
    header = HEADERS["en"].replace("torque [Nm]", "torque [§]", 1).split(";")
    done = run(
        "import",
        written(tmp_path / "b.csv", header),
        "--out",
        tmp_path / "o.csv",
        "--yes",
    )
    assert done.code == 2
    assert "[§]" in done.err


def test_text_that_is_named_as_a_spreadsheet(tmp_path):
    path = written(tmp_path / "bench.xls", HEADERS["en"].split(";"))
    done = run("import", path, "--out", tmp_path / "o.csv", "--yes")
    assert done.code == 2
    assert (
        "is text, no Excel file, in spite of its name: rename it to bench.csv"
        in done.err
    )


def cycle(path, header, row):
    lines = [header]
    for second in range(20):
        lines.append(f"{second},{row}")
    path.write_text("\n".join(lines) + "\n")
    return read_cycle(path)


@pytest.mark.parametrize(
    "name", ["pto_power [kW]", "PTO_Power [kW]", "pto power [kW]", "PTO-Power (kW)"]
)
def test_names_of_cycles(tmp_path, name):
    read = cycle(
        tmp_path / "c.csv",
        f"Time [s],Ground Speed [km/h],Drawbar_Force [kN],{name}",
        "8,20,30",
    )
    assert read.pto_power[0] == 30e3
    assert read.remarks == ()


def test_columns_of_cycles_that_are_not_used_are_named(tmp_path):
    header = "time,output_speed,output_power,slope [%],operator"
    read = cycle(tmp_path / "c.csv", header, "100,5000,3,7")
    assert read.remarks == (
        "columns not used: slope [%], operator",
        "without a unit, taken as: output_speed [rad/s], output_power [W]",
    )


def test_a_name_like_a_known_one_is_asked(tmp_path):
    header = "time,ground_speed,drawbar_force,pto_torque [Nm]"
    with pytest.raises(InputError, match="begins like pto_power"):
        cycle(tmp_path / "c.csv", header, "2,5000,300")


@pytest.mark.parametrize(
    "header",
    [
        "cycSecs,cycMps,cycGrade",
        "time_s,speed_mps,grade",
        "time [s],v [m/s],Steigung",
    ],
)
def test_a_cycle_without_a_load(tmp_path, header):
    read = cycle(tmp_path / "c.csv", header, "2.2,0.01")
    forced = cycle(
        tmp_path / "f.csv", "time,ground_speed,slope,drawbar_force", "2.2,0.01,0"
    )
    np.testing.assert_array_equal(read.output_power, forced.output_power)
    assert "a drawbar force of 0 N is taken" in read.remarks[0]
    assert forced.remarks == (
        "without a unit, taken as: ground_speed [m/s], drawbar_force [N]",
    )


@pytest.mark.parametrize(
    ("header", "row", "complaint"),
    [
        (
            "time,Ground Speed,drawbar_force [kN]",
            "8,20",
            "'Ground Speed' states no unit",
        ),
        ("time,vehicle speed,drawbar_force [kN]", "8,20", "states no unit: call it"),
        ("time,ground_speed [km/h],Zugkraft", "8,20", "'Zugkraft' states no unit"),
        ("time,ground_speed [km/h],drawbar_force", "8,20", r"drawbar_force \[kN\] or"),
        (
            "time,ground_speed [km/h],auxiliary_power",
            "8,12",
            r"auxiliary_power \[kW\] or",
        ),
    ],
)
def test_units_that_a_cycle_leaves_open(tmp_path, header, row, complaint):
    with pytest.raises(InputError, match=complaint):
        cycle(tmp_path / "c.csv", header, row)


@pytest.mark.parametrize(
    "header",
    [
        "Zeit [s],Abtriebsdrehzahl [1/min],Abtriebsleistung [kW],Zapfwellenleistung [kW]",
        "t [s],n_output [rpm],P_out [kW],P_pto [kW]",
        "<t> [s],n_out [rpm],P_output [kW],PTO power [kW]",
        "elapsed time [s],output speed [rpm],Output Power (kW),PTO (kW)",
    ],
)
def test_names_of_cycles_in_other_words(tmp_path, header):
    read = cycle(tmp_path / "c.csv", header, "600,20,30")
    assert read.output_speed[0] == pytest.approx(20.0 * np.pi)
    assert read.output_power[0] == 20e3
    assert read.pto_power[0] == 30e3
    assert read.remarks == ()


def test_the_speed_of_a_pto_whose_power_is_there_is_put_aside(tmp_path):
    header = (
        "time,ground_speed [km/h],drawbar_force [kN],pto_power [kW],PTO speed [rpm]"
    )
    read = cycle(tmp_path / "c.csv", header, "8,20,30,540")
    assert read.remarks == ("columns not used: PTO speed [rpm]",)


def test_the_torque_of_a_cycle_gives_its_power(tmp_path):
    header = "time,output_speed [rpm],output_torque [Nm]"
    read = cycle(tmp_path / "c.csv", header, "600,500")
    assert read.output_power[0] == pytest.approx(20.0 * np.pi * 500.0)


def engine_map(path, worst=230.0):
    rng = np.random.default_rng(3)
    lines = ["engine_speed [r/min],torque [N m],fuel [g/kWh]"]
    for speed in (1000, 1500, 2000):
        for torque, fuel in ((100, 300), (250, worst), (400, 220)):
            lines.append(f"{speed + rng.uniform(-3.0, 3.0):.1f},{torque},{fuel}")
    path.write_text("\n".join(lines) + "\n")
    return hmcvt.load_engine(path)


def test_measured_speeds_of_an_engine_map(tmp_path):
    engine = engine_map(tmp_path / "e.csv")
    np.testing.assert_allclose(
        engine.speed, np.array([1000, 1500, 2000]) * np.pi / 30, rtol=3e-3
    )


def test_an_absurd_fuel_at_part_load_is_refused(tmp_path):
    with pytest.raises(
        InputError, match=r"row \d+: \d+ r/min, 250 N m: fuel at part load"
    ):
        engine_map(tmp_path / "e.csv", worst=2100.0)


ENGINE_POINTS = [
    (speed, torque, fuel)
    for speed in (1000.0, 1500.0, 2000.0)
    for torque, fuel in ((100.0, 300.0), (250.0, 230.0), (400.0, 220.0))
]
"""Speed [r/min], torque [N m] and fuel [g/kWh]."""


@pytest.mark.parametrize(
    ("header", "sizes"),
    [
        ("rpm,torque_Nm,bsfc_g_per_kWh", (1.0, 1.0, 1.0)),
        ("Engine Speed (rpm),Torque (lb-ft),BSFC (g/kW-hr)", (1.0, 1.35582, 1.0)),
        ("R\u00e9gime moteur (tr/min),Couple moteur [daN m],BSFC [g/kWh]", (1, 10, 1)),
        ("Motordrehzahl [U/min],Motormoment [Nm],Verbrauch [kg/kWh]", (1, 1, 1e3)),
        (
            "\u53d1\u52a8\u673a\u8f6c\u901f(r/min),\u626d\u77e9(N\u00b7m),fuel (g/kWh)",
            (1, 1, 1),
        ),
    ],
)
def test_names_and_units_of_engine_maps(tmp_path, header, sizes):
    lines = [header]
    for point in ENGINE_POINTS:
        cells = [value / size for value, size in zip(point, sizes, strict=True)]
        lines.append(",".join(f"{cell:.9g}" for cell in cells))
    path = tmp_path / "e.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    engine = hmcvt.load_engine(path)
    np.testing.assert_allclose(engine.speed, np.pi / 30.0 * np.array([1e3, 1.5e3, 2e3]))
    np.testing.assert_allclose(engine.full_load, 400.0, rtol=1e-4)
    np.testing.assert_allclose(engine.specific_fuel[:, -1], 220.0, rtol=1e-4)
    assert engine.remarks == ()


def test_what_of_an_engine_map_is_not_used_is_named(tmp_path):
    lines = ["engine_speed [r/min],torque [N m],fuel [g/kWh],NOx [g/kWh]"]
    lines += [
        f"{speed:g},{torque:g},{fuel:g},3" for speed, torque, fuel in ENGINE_POINTS
    ]
    lines.append("1500,-40,0,0")
    path = tmp_path / "e.csv"
    path.write_text("\n".join(lines) + "\n")
    engine = hmcvt.load_engine(path)
    assert engine.remarks == (
        "e.csv: 1 rows in which the engine gives no power are not used",
        "e.csv: columns not used: NOx [g/kWh]",
    )
    assert "remarks" not in engine.to_dict()
    done = run("mission", "transport", "--engine", path, "--json")
    assert set(engine.remarks) <= set(done.json["remarks"]), done.err


def test_a_table_without_names_is_refused(tmp_path):
    path = tmp_path / "wltc.csv"
    path.write_text("0.0,0.0\n1.0,0.4\n2.0,1.1\n")
    for read in (read_cycle, hmcvt.load_engine, hmcvt.read_bench):
        with pytest.raises(InputError, match="row 1: holds numbers only"):
            read(path)


def test_a_column_of_an_engine_map_without_a_unit_is_asked(tmp_path):
    path = tmp_path / "e.csv"
    path.write_text("engine speed [rpm],torque,fuel [g/kWh]\n1000,100,300\n")
    with pytest.raises(InputError, match="'torque' states no unit, one of N m"):
        hmcvt.load_engine(path)


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (quantities.speed, "1400 tr/min", 1400.0 * np.pi / 30.0),
        (quantities.speed, "1400 U/min", 1400.0 * np.pi / 30.0),
        (quantities.torque, "20daNm", 200.0),
        (quantities.torque, "100 lb-ft", 135.58179483),
        (quantities.power, "0.05MW", 5e4),
        (quantities.fraction, "55\u2030", 0.055),
    ],
)
def test_units_of_options_are_those_of_tables(kind, text, value):
    assert kind(text) == pytest.approx(value)


@pytest.mark.parametrize("text", ["20 1/s", "20 Hz", "20 Nm"])
def test_an_option_refuses_a_unit_that_is_open_or_another(text):
    with pytest.raises(click.BadParameter, match="is not a speed"):
        quantities.speed(text)


def test_units_of_a_vehicle_file_are_those_of_tables(tmp_path):
    path = tmp_path / "v.yaml"
    path.write_text(
        "schema: hmcvt-vehicle/1\nslip: {value: 80, unit: \u2030}\n"
        "pto_speed_low: {value: 1900, unit: U/min}\n"
        "limits: {stage_change_time: {value: 400, unit: ms}}\n",
        encoding="utf-8",
    )
    vehicle = hmcvt_tools.load_vehicle(path)
    assert vehicle.slip == pytest.approx(0.08)
    assert vehicle.pto_speed_low == pytest.approx(1900.0 * np.pi / 30.0)
    assert vehicle.limits.stage_change_time == pytest.approx(0.4)
    path.write_text("schema: hmcvt-vehicle/1\nslip: {value: 0.5, unit: -@0.5}\n")
    with pytest.raises(InputError, match=r"slip\.unit"):
        hmcvt_tools.load_vehicle(path)


def unit_bench(path, most):
    lines = ["displacement_cm3,speed_rpm,pressure_bar,flow_L/min,torque_Nm"]
    for displacement in (28.0, most):
        for speed in (800, 1500):
            for pressure in (50, 150, 250):
                flow = 0.97e-3 * displacement * speed
                torque = displacement * pressure * 0.1 / (2.0 * np.pi) / 0.93
                lines.append(
                    f"{displacement},{speed},{pressure},{flow:.3f},{torque:.3f}"
                )
    path.write_text("\n".join(lines) + "\n")
    return hmcvt_tools.read_unit(path, kind="pump", displacement="56 cm3")


def test_a_displacement_little_above_the_plate(tmp_path):
    samples = unit_bench(tmp_path / "p.csv", 56.5)
    assert samples.displacement_ratio.max() == 1.0
    assert "6 rows state a displacement of up to 0.89 % above" in samples.notes[0]


def test_columns_of_a_unit_bench_that_are_not_used_are_named(tmp_path):
    path = tmp_path / "p.csv"
    unit_bench(path, 56.0)
    head, *rows = path.read_text().splitlines()
    lines = [f"{head},remark,vibration_mm_s", *(f"{row},warm,0.4" for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    samples = hmcvt_tools.read_unit(path, kind="pump", displacement="56 cm3")
    assert "columns not used: remark, vibration_mm_s" in samples.notes


def test_a_displacement_far_above_the_plate(tmp_path):
    with pytest.raises(InputError, match="add --displacement 61:cm3"):
        unit_bench(tmp_path / "p.csv", 61.0)
