# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Tables with names and units of their own, and torques of both shafts."""

import pytest

import hmcvt_core as hmcvt
from hmcvt_core.transmission.ranges import RPM
from hmcvt_tools import read_raw_bench
from hmcvt_tools.tables.proposal import propose
from hmcvt_tools.tables.raw import UNITS, choose_columns

SHAFTS = {
    "displacement_ratio": "stroke:%",
    "engine_speed": "n_e:rpm",
    "engine_torque": "M_e",
    "output_speed": "n_o:r/min",
    "output_torque": "M_o:kNm",
}
PLAIN = {
    "displacement_ratio": "eps",
    "engine_speed": "n",
    "load_torque": "M",
    "efficiency": "eta",
}
HEADER = "no,stroke,n_e,M_e,n_o,M_o,remark\n"
TABLE = HEADER + "1,50,1400,250,1890,0.14,warm\n2,-80,1000,200,600,0.25,\n"


def raw(tmp_path, text=TABLE, name="raw.csv"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_torque_of_the_engine_and_load_torque_are_enough(tmp_path):
    path = raw(tmp_path, "eps,n,M,M_e\n0.5,146,200,250\n")
    columns = {name: text for name, text in PLAIN.items() if name != "efficiency"}
    found = read_raw_bench(path, columns | {"engine_torque": "M_e"})
    assert found.efficiency.tolist() == [0.8]


@pytest.mark.parametrize("name", ["oil-temperature", "Output Speed", "Efficiency"])
def test_a_column_with_the_name_of_a_quantity_that_is_not_asked_for_is_renamed(
    tmp_path, name
):
    """It would be read as that quantity, in whatever unit, from the file written."""
    path = raw(
        tmp_path, f"eps,n,M,eta,{name},,,a,a,a (2)\n0.5,146,200,0.8,353,1,2,x,y,z\n"
    )
    found = read_raw_bench(path, PLAIN)
    assert found.extra == {
        f"raw {name}": ("353",),
        "unnamed": ("1",),
        "unnamed (2)": ("2",),
        "a": ("x",),
        "a (3)": ("y",),
        "a (2)": ("z",),
    }
    hmcvt.write_bench(tmp_path / "bench.csv", found)
    again = hmcvt.read_bench(tmp_path / "bench.csv")
    assert again.oil_temperature is None and again.output_speed is None
    assert again.efficiency.tolist() == [0.8] and again.engine_speed.tolist() == [146.0]


@pytest.mark.parametrize(
    ("unit", "value"), [("bar", 250.0), ("MPa", 25.0), ("psi", 3625.943)]
)
def test_pressure_in_the_units_of_gauges(tmp_path, unit, value):
    path = raw(tmp_path, f"eps,n,M,eta,p\n0.5,146,200,0.8,{value}\n")
    found = read_raw_bench(path, {**PLAIN, "pressure": f"p:{unit}"})
    assert found.pressure == pytest.approx([2.5e7])
    hmcvt.write_bench(tmp_path / "bench.csv", found)
    assert (
        hmcvt.read_bench(tmp_path / "bench.csv").pressure.tolist()
        == found.pressure.tolist()
    )
    with pytest.raises(
        hmcvt.InputError,
        match=r"row 2: pressure = 2.5e\+08 is outside -6e\+07 to "
        r"6e\+07 Pa \(high less low side of the motor\); column 'p' is taken as",
    ):
        read_raw_bench(
            raw(tmp_path, "eps,n,M,eta,p\n0.5,146,200,0.8,250\n"),
            {**PLAIN, "pressure": "p:MPa"},
        )


@pytest.mark.parametrize(
    ("quantity", "cell", "message"),
    [
        (
            "pressure",
            "0.5,146,200,0.8,350 bar",
            "bar in column 'x' is not in Pa; write x:bar",
        ),
        (
            "oil_temperature",
            "0.5,146,200,0.8,140 °F",
            "deg F in .* is not in deg C; write x:deg F",
        ),
        (
            "oil_temperature",
            "0.5,146,200,0.8,60 bar",
            "bar in column 'x' is not in deg C$",
        ),
    ],
)
def test_a_unit_in_the_cells_is_never_passed_over(tmp_path, quantity, cell, message):
    path = raw(tmp_path, f"eps,n,M,eta,x\n{cell}\n")
    with pytest.raises(hmcvt.InputError, match=message):
        read_raw_bench(path, {**PLAIN, quantity: "x"})


def test_a_row_of_units_and_lines_above_the_header(tmp_path):
    path = raw(
        tmp_path,
        "bench 3, run of 2026-11-21\nsep=,\neps,n,M,eta\n[-],[rad/s],[Nm],[-]\n"
        "0.5,146,200,0.8\n",
    )
    for row in (3, None):  # the names that are asked for tell which row is the header
        found = read_raw_bench(path, PLAIN, header_row=row)
        assert found.engine_speed.tolist() == [146.0]
    path = raw(tmp_path, "eps,n,M,eta\n[-],[rad/s],[Nm],[-]\n0.5,9,200,0.8\n")
    with pytest.raises(hmcvt.InputError, match="row 3: engine_speed = 9 is outside"):
        read_raw_bench(path, PLAIN)


@pytest.mark.parametrize("row", ["nan,nan,nan,nan", ",,,0", "-,-,-,1e999"])
def test_a_row_without_values_is_no_row_of_units(tmp_path, row):
    with pytest.raises(hmcvt.InputError, match="row 2: "):
        read_raw_bench(raw(tmp_path, f"eps,n,M,eta\n{row}\n0.5,146,200,0.8\n"), PLAIN)


@pytest.mark.parametrize(
    ("rows", "load"),
    [
        ("0,5;146;850;0,8\n0,5;146;1.200;0,8", [850.0, 1200.0]),
        ("0,5;146;850,250;0,8\n0,5;146;1.200,5;0,8", [850.25, 1200.5]),
        ("0.5;146;850.250;0.8\n0.5;146;200.125;0.8", [850.25, 200.125]),
    ],
)
def test_points_and_commas_are_told_apart(tmp_path, rows, load):
    """A bench table is plain: it has nothing between thousands."""
    path = raw(
        tmp_path, f"displacement_ratio;engine_speed;load_torque;efficiency\n{rows}\n"
    )
    named = {name: name for name in PLAIN}
    assert read_raw_bench(path, named).load_torque.tolist() == load
    if "1.200" in rows:
        with pytest.raises(
            hmcvt.InputError, match=r"row 3: load_torque '1.200.*between thousands"
        ):
            hmcvt.read_bench(path)
    else:
        assert hmcvt.read_bench(path).load_torque.tolist() == load


def test_the_first_unit_is_the_one_that_is_kept():
    for units in UNITS.values():
        assert next(iter(units.values())) == 1.0


@pytest.mark.parametrize(
    ("header", "text", "expected"),
    [
        ("n", "n", 100.0),
        ("n", "n:rpm", 100.0 * RPM),
        ("n", " n : r/min ", 100.0 * RPM),
        ("n: engine", "n: engine", 100.0),
        ("a:b", "a:b:rpm", 100.0 * RPM),
        ("n", "1500:rpm", 1500.0 * RPM),
        ("7", "7:rpm", 100.0 * RPM),  # for all rows; a column
    ],
)
def test_column_and_unit(tmp_path, header, text, expected):
    path = raw(tmp_path, f"eps,{header},M,eta\n0,100,200,0.8\n")
    assert read_raw_bench(
        path, {**PLAIN, "engine_speed": text}
    ).engine_speed.tolist() == [expected]


@pytest.mark.parametrize(
    ("quantity", "plain", "other", "cell"),
    [
        ("engine_speed", "engine speed", "n engine idle [rpm]", 150),
        ("efficiency", "efficiency", "volumetric efficiency [%]", 0.8),
        ("stamp", "time [s]", "operating time [h]", 9),
        ("oil_temperature", "sump temperature [degC]", "T_MOTOR [degC]", 60),
    ],
)
def test_the_guess_takes_the_column_of_plain_words(
    tmp_path, quantity, plain, other, cell
):
    named = {
        name: text for name, text in zip(PLAIN, "abcd", strict=True) if name != quantity
    }
    path = raw(tmp_path, f"a,b,c,d,{other},{plain}\n0.5,150,200,0.8,{cell},{cell}\n")
    table, chosen = choose_columns(path, named)
    proposal = propose(table, chosen.columns)
    assert proposal.columns[quantity].name == plain


def test_a_recording_is_none_of_steady_tests_whatever_its_row_of_units_says(tmp_path):
    path = raw(
        tmp_path,
        "start time,time,eps,n,M,eta\nhh:mm:ss,hh:mm:ss,-,rpm,Nm,-\n"
        + "".join(f"0,{0.1 * i:.1f},0.5,1500,200,0.8\n" for i in range(200)),
    )
    with pytest.raises(
        hmcvt.InputError, match="column 'time' looks like that of a recording"
    ):
        read_raw_bench(path, {**PLAIN, "engine_speed": "n:rpm"})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        *[
            ({"engine_speed": text}, "engine_speed: column '' is missing")
            for text in ("", " ", ":rpm")
        ],
        (
            {"engine_torque": "torque"},
            "engine_torque: column 'torque' is missing; there is no, stroke",
        ),
        (
            {"engine_speed": "n_e:Hz"},
            "^engine_speed: 'Hz' is no unit of it; there is rad/s, rpm, r/min",
        ),
        (
            {"displacement_ratio": "stroke:deg"},
            "^displacement_ratio: 'deg' is no unit of it; there is -, %",
        ),
        ({"torque": "M_e"}, "torque is no quantity of a bench; there is displ"),
        ({"efficiency": "remark"}, "efficiency and engine_torque say the same twice"),
        ({"load_torque": "remark"}, "load_torque and output_torque say the same twice"),
        ({"output_speed": "n_e:rpm"}, "column 'n_e' is named twice"),
        (
            {"engine_speed": "n_e"},
            r"row 2: engine_speed = 1400 .*; column 'n_e' is taken as rad/s: "
            "another unit is written n_e:UNIT, one of rad/s, rpm",
        ),
    ],
)
def test_a_column_that_does_not_fit_is_told(tmp_path, change, message):
    with pytest.raises(hmcvt.InputError, match=message):
        read_raw_bench(raw(tmp_path), SHAFTS | change)


@pytest.mark.parametrize(
    ("left", "message"),
    [
        ({"engine_torque"}, "efficiency (or engine_torque or engine_power)"),
        ({"output_speed"}, "load_torque (or output_speed)"),
        (
            {"output_speed", "output_torque"},
            "load_torque (or output_power, or output_torque and output_speed)",
        ),
        ({"displacement_ratio", "engine_speed"}, "displacement_ratio, engine_speed"),
    ],
)
def test_what_is_missing_is_named(tmp_path, left, message):
    some = {name: column for name, column in SHAFTS.items() if name not in left}
    with pytest.raises(hmcvt.InputError) as caught:
        read_raw_bench(raw(tmp_path), some)
    assert str(caught.value) == f"no column is named for {message}"


@pytest.mark.parametrize(
    ("row", "message"),
    [
        *[
            (f"{word},50,1400,250,1890,0.14,", f"row 2: '{word}' is no test")
            for word in (
                "Maximum",
                "Minimum:",
                "Median",
                "Mean values",
                "Std. dev.",
                "RMS",
                "Durchschnitt",
                "Gesamt",
                "Streuung",
                "Standardabweichung",
                "Médiane",
                "stdev",
            )
        ],
        (
            "3,50,1400,250,1890,140,",
            "row 2: output_torque = 140000 is outside 0.1 to 20000 N m",
        ),
        (
            "3,50,1400,0,1890,0.14,",
            "row 2: engine_torque = 0 is outside 0.1 to 20000 N m",
        ),
        ("3,50,1400,2_50,1890,0.14,", "row 2: M_e '2_50' is not a number"),
        (
            "3,50,1400,250,0,0.14,",
            "row 2: output_speed = 0 is outside 0.1 to 1000 rad/s",
        ),
        ("3,50,1400,250,nan,0.14,", "row 2: output_speed = nan is not finite"),
        (
            "3,50,1400,250,1890,1.4,",
            "row 2: efficiency = .* is outside .*; computed from torques and "
            "speeds of the shafts: check their columns and units",
        ),
        (
            "3,50,1400,20000,1890,20,",
            "row 2: load_torque = 27000 is outside .*; computed from torques",
        ),
    ],
)
def test_a_bad_row_is_named(tmp_path, row, message):
    with pytest.raises(hmcvt.InputError, match=message):
        read_raw_bench(raw(tmp_path, f"{HEADER}{row}\n"), SHAFTS)


def test_a_row_of_units_holds_for_a_column_named_without_unit(tmp_path):
    text = "eps,n,M,eta,x\n-,rad/s,Nm,-,bar\n0.5,146,200,0.8,350\n"
    found = read_raw_bench(raw(tmp_path, text), {**PLAIN, "pressure": "x"})
    assert found.pressure.tolist() == [3.5e7]


def test_points_beside_decimal_commas_are_between_thousands(tmp_path):
    text = "displacement_ratio;engine_speed;load_torque;efficiency\n"
    path = raw(tmp_path, f"{text}0,5;146;850.250;0,8\n0,5;146;200.125;0,8\n")
    with pytest.raises(hmcvt.InputError, match="load_torque = 850250 is outside"):
        read_raw_bench(path, {name: name for name in PLAIN})
    with pytest.raises(hmcvt.InputError, match=r"'850.250'.*between thousands"):
        hmcvt.read_bench(path)
