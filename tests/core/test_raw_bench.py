# SPDX-License-Identifier: Apache-2.0
"""Tables with names and units of their own, and torques of both shafts."""

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core import read_raw_bench
from hmcvt_core.ranges import RPM
from hmcvt_core.raw_bench import UNITS

SHAFTS = {
    "displacement_ratio": "stroke:%",
    "engine_speed": "n_e:rpm",
    "engine_torque": "M_e",
    "output_speed": "n_o:r/min",
    "output_torque": "M_o:kNm",
}
HEADER = "no,stroke,n_e,M_e,n_o,M_o,remark\n"
TABLE = HEADER + "1,50,1400,250,1890,0.14,warm\n2,-80,1000,200,600,0.25,\n"


def raw(tmp_path, text=TABLE, name="raw.csv"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_units_and_shaft_torques_give_what_the_reader_would_work_out(tmp_path):
    found = read_raw_bench(raw(tmp_path), SHAFTS)
    assert found.displacement_ratio.tolist() == pytest.approx([0.5, -0.8])
    assert found.engine_speed == pytest.approx(np.array([1400.0, 1000.0]) * np.pi / 30.0)
    assert found.output_speed == pytest.approx(np.array([1890.0, 600.0]) * np.pi / 30.0)
    assert found.load_torque == pytest.approx([140.0 * 1890.0 / 1400.0, 250.0 * 600.0 / 1000.0])
    assert found.efficiency == pytest.approx(
        [140.0 * 1890.0 / (250.0 * 1400.0), 250.0 * 600.0 / (200.0 * 1000.0)])


def test_other_columns_are_kept(tmp_path):
    found = read_raw_bench(raw(tmp_path), SHAFTS)
    assert found.extra == {"no": ("1", "2"), "remark": ("warm", "")}
    out = tmp_path / "bench.csv"
    hmcvt.write_bench(out, found)
    again = hmcvt.read_bench(out)
    assert again.extra == found.extra
    assert again.efficiency.tolist() == found.efficiency.tolist()


def test_a_column_with_the_name_of_a_quantity_that_is_not_asked_for_is_left_out(tmp_path):
    """It would be read as that quantity, in whatever unit, from the file written."""
    path = raw(tmp_path, "eps,n,M,eta,oil_temperature\n0.5,1400,200,0.8,353\n")
    found = read_raw_bench(path, {
        "displacement_ratio": "eps", "engine_speed": "n:rpm",
        "load_torque": "M", "efficiency": "eta"})
    assert found.extra == {} and found.oil_temperature is None


def test_measured_efficiency_and_load(tmp_path):
    path = raw(tmp_path, "eps;n;M;eta;std;T\n0,5;146,6;200,5;79,4;0,3;55\n")
    found = read_raw_bench(path, {
        "displacement_ratio": "eps", "engine_speed": "n",
        "load_torque": "M", "efficiency": "eta:%",
        "efficiency_std": "std:%",
        "oil_temperature": "T"})
    assert found.efficiency.tolist() == pytest.approx([0.794])
    assert found.efficiency_std.tolist() == pytest.approx([0.003])
    assert (found.engine_speed[0], found.load_torque[0]) == (146.6, 200.5)
    assert found.oil_temperature.tolist() == [55.0]


def test_the_first_unit_is_the_one_that_is_kept():
    for units in UNITS.values():
        assert next(iter(units.values())) == 1.0


@pytest.mark.parametrize(("header", "text", "expected"), [
    ("n", "n", 100.0), ("n", "n:rpm", 100.0 * RPM), ("n", " n : r/min ", 100.0 * RPM),
    ("n: engine", "n: engine", 100.0), ("a:b", "a:b:rpm", 100.0 * RPM),
])
def test_column_and_unit(tmp_path, header, text, expected):
    path = raw(tmp_path, f"eps,{header},M,eta\n0,100,200,0.8\n")
    found = read_raw_bench(path, {"displacement_ratio": "eps", "engine_speed": text,
                                  "load_torque": "M", "efficiency": "eta"})
    assert found.engine_speed.tolist() == [expected]


@pytest.mark.parametrize("text", ["", " ", ":rpm"])
def test_a_column_needs_a_name(tmp_path, text):
    with pytest.raises(hmcvt.InputError, match=r"engine_speed: .* names no column: write COLUMN"):
        read_raw_bench(raw(tmp_path), SHAFTS | {"engine_speed": text})


def test_a_quantity_that_is_none_is_refused(tmp_path):
    with pytest.raises(hmcvt.InputError, match="torque is no quantity of a bench; there is displ"):
        read_raw_bench(raw(tmp_path), SHAFTS | {"torque": "M_e"})


@pytest.mark.parametrize(("left", "message"), [
    ({"engine_torque"}, "efficiency (or engine_torque)"),
    ({"output_speed"}, "load_torque (or output_speed), efficiency (or output_speed)"),
    ({"displacement_ratio", "engine_speed"}, "displacement_ratio, engine_speed"),
])
def test_what_is_missing_is_named(tmp_path, left, message):
    some = {name: column for name, column in SHAFTS.items() if name not in left}
    with pytest.raises(hmcvt.InputError) as caught:
        read_raw_bench(raw(tmp_path), some)
    assert str(caught.value) == f"no column is named for {message}"


@pytest.mark.parametrize("twice", [{"efficiency": "remark"}, {"load_torque": "remark"}])
def test_what_is_told_twice_is_refused(tmp_path, twice):
    columns = SHAFTS | twice
    with pytest.raises(hmcvt.InputError, match="say the same twice"):
        read_raw_bench(raw(tmp_path), columns)


def test_one_column_for_two_quantities_is_refused(tmp_path):
    columns = SHAFTS | {"output_speed": "n_e:rpm"}
    with pytest.raises(hmcvt.InputError, match="column 'n_e' is named twice"):
        read_raw_bench(raw(tmp_path), columns)


@pytest.mark.parametrize(("row", "message"), [
    ("3,50,1400,250,1890,140,", "row 2: load_torque = 189000 is outside 1 to 5000 N m"),
    ("3,50,1400,0,1890,0.14,", "row 2: efficiency[ =]+inf is not finite"),
    ("3,50,1400,250,0,0.14,", "row 2: output_speed = 0 is outside 0.1 to 1000 rad/s"),
    ("3,50,14000,250,1890,0.14,", "row 2: engine_speed = 1466.08 is outside 10 to 320 rad/s"),
    ("3,0.5,1400,250,x,0.14,", "row 2: n_o 'x' is not a number"),
    ("3,500,1400,250,1890,0.14,", "row 2: displacement_ratio = 5 is outside -1 to 1"),
    ("3,50,1400,250,nan,0.14,", "row 2: output_speed = nan is not finite"),
    ("3,50,1400,250,1890,-0.14,", "row 2: load_torque = -189 is outside 1 to 5000 N m"),
    ("3,50,1400,-250,1890,0.14,", "row 2: efficiency = -0.756 is outside"),
])
def test_a_bad_row_is_named(tmp_path, row, message):
    with pytest.raises(hmcvt.InputError, match=message):
        read_raw_bench(raw(tmp_path, f"{HEADER}{row}\n"), SHAFTS)


def test_a_value_computed_from_the_shafts_says_so(tmp_path):
    with pytest.raises(hmcvt.InputError, match="computed from torques and speeds of the shafts"):
        read_raw_bench(raw(tmp_path, f"{HEADER}3,50,1400,250,1890,140,\n"), SHAFTS)


def test_a_column_that_is_not_there_is_named(tmp_path):
    columns = SHAFTS | {"engine_torque": "torque"}
    with pytest.raises(hmcvt.InputError, match=r"column torque is missing; there is no, stroke"):
        read_raw_bench(raw(tmp_path), columns)
