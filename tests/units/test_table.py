# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Makers' tables: the losses made of them, their noise, and what is refused."""

import numpy as np
import pytest

from hmcvt_core import InputError
from hmcvt_core.benches.unit import diagnose_unit
from hmcvt_tools.tables.unit_table import read_unit

from .bench import CM3, DAMPING, LEAKAGE, TURN, efficiencies, grid, table

SPEED, PRESSURE = grid()
EXACT = {"rtol": 2e-4}


@pytest.mark.parametrize("kind", ["pump", "motor"])
def test_losses_are_those_of_the_table(tmp_path, kind):
    found = read_unit(
        table(  # by the pair that is whole
            tmp_path / "t.csv",
            SPEED,
            PRESSURE,
            efficiencies(SPEED, PRESSURE, kind),
            more=",9",
            head="displacement_cc,pressure_bar,speed_rpm,volumetric,mechanical,torque_loss",
        ),
        kind=kind,
    )
    w, p = SPEED * TURN / 60.0, PRESSURE * 1e5
    np.testing.assert_allclose(found.speed, w, **EXACT)
    np.testing.assert_allclose(found.flow_loss, LEAKAGE * p, atol=2e-8)
    np.testing.assert_allclose(
        found.torque_loss, DAMPING * w + 0.01 * p * CM3 * 1e-6 / TURN, atol=2e-3
    )
    assert found.displacement == pytest.approx(CM3 * 1e-6 / TURN)


def test_other_units_of_a_table(tmp_path):
    pair = efficiencies(SPEED, PRESSURE)
    first = read_unit(table(tmp_path / "a.csv", SPEED, PRESSURE, pair), kind="pump")
    percent = read_unit(
        table(
            tmp_path / "b.csv",
            SPEED * TURN / 60.0,
            PRESSURE / 10.0,
            [100.0 * each for each in pair],
            "displacement [cm3/r],Pressure [MPa],speed,volumetric_efficiency_%,mechanical (%),kind",
            more=",pump",
        )
    )
    losses = read_unit(
        table(
            tmp_path / "c.csv",
            SPEED,
            PRESSURE,
            (6e4 * first.flow_loss, first.torque_loss),
            "displacement_cm3,pressure_bar,speed_r/min,flow_loss_L/min,torque_loss [N m]",
        ),
        kind="pump",
    )
    for other in (percent, losses):
        np.testing.assert_allclose(other.losses, first.losses, rtol=5e-3, atol=3e-7)


@pytest.mark.parametrize("kind", ["pump", "motor"])
def test_noise_of_the_meters_reaches_the_losses(tmp_path, kind):
    pair, rng = efficiencies(SPEED, PRESSURE, kind), np.random.default_rng(0)
    exact = read_unit(
        table(tmp_path / "t.csv", SPEED, PRESSURE, pair), kind=kind, noise=0.01
    )
    # Flow and torque read 1 % wrong, and the gauge by half a bar.
    drawn = []
    for _ in range(400):
        eta = [each * (1.0 + 0.01 * rng.standard_normal(len(each))) for each in pair]
        eta[1] = eta[1] * (1.0 + 0.5 / PRESSURE * rng.standard_normal(len(SPEED)))
        if kind == "pump":
            drawn.append(
                (exact.ideal[0] * (1.0 - eta[0]), exact.ideal[1] * (1.0 / eta[1] - 1.0))
            )
        else:
            drawn.append(
                (exact.ideal[0] * (1.0 / eta[0] - 1.0), exact.ideal[1] * (1.0 - eta[1]))
            )
    np.testing.assert_allclose(exact.deviation, np.std(drawn, axis=0), rtol=0.25)


def test_rows_without_pressure_tell_no_torque(tmp_path):
    at = np.append(0.0, PRESSURE[1:])
    found = read_unit(
        table(tmp_path / "t.csv", SPEED, at, efficiencies(SPEED, at)), kind="pump"
    )
    assert efficiencies(SPEED, at)[1][0] == 0.0 and found.torque_loss[0] == 0.0
    assert (
        diagnose_unit(found, deals=False)
        .diagnosis.notes[0]
        .startswith("1 samples below 100000 Pa")
    )
    with pytest.raises(InputError, match="0 of the highest pressure parts no samples"):
        found.divided("pressure", 0.0)


def test_one_unit_of_several(tmp_path):
    lines = (
        table(
            tmp_path / "t.csv",
            SPEED,
            PRESSURE,
            efficiencies(SPEED, PRESSURE),
            "displacement_cc,pressure_bar,speed_rpm,volumetric,mechanical,unit",
            more=",A",
        )
        .read_text()
        .splitlines()
    )
    path = tmp_path / "two.csv"
    path.write_text(
        "\n".join([*lines, *(line[:-1] + "B" for line in lines[2:12])]) + "\n"
    )
    assert len(read_unit(path, kind="pump", unit="B")) == 10
    with pytest.raises(InputError, match="--unit names one of A, B"):
        read_unit(path, kind="pump")


HEAD = "displacement_cc,pressure_bar,speed_rpm,volumetric,mechanical"
LOSSES = "displacement_cc,pressure_bar,speed_rpm,flow_loss,torque_loss"


@pytest.mark.parametrize(
    ("head", "scale", "told"),
    [
        (HEAD, (1, 1, 100, 100), "volumetric_efficiency = 9.* not percent"),
        (
            HEAD.replace("_bar", ""),
            (1, 1, 1, 1),
            "the highest pressure is 400 Pa.*in bar",
        ),
        (HEAD.replace("_rpm", ""), (1, 1, 1, 1), "speed = .*is it in r/min"),
        (HEAD.replace("_rpm", ""), (1, 0.4, 1, 1), "speed = .*is it in r/min"),
        (
            HEAD.replace("_cc", ""),
            (1, 1, 1, 1),
            "displacement = 71 .*cm3 per revolution",
        ),
        (LOSSES, (1, 1, 60, 1), "flow_loss = .*is it in L/min"),
        (LOSSES, (1, 1, 0.01, 1), "flow_loss = .*more than all that the unit moves"),
        (
            HEAD.replace("speed_rpm", "n_x"),
            (1, 1, 1, 1),
            "column speed is missing; there is .*, n_x",
        ),
    ],
    ids=["percent", "bar", "r/min", "slow r/min", "cm3", "L/min", "ml/s", "no speed"],
)
def test_a_table_in_the_wrong_unit_is_named(tmp_path, head, scale, told):
    columns = [
        each * factor
        for each, factor in zip(
            (PRESSURE, SPEED, *efficiencies(SPEED, PRESSURE)), scale, strict=True
        )
    ]
    path = table(tmp_path / "t.csv", columns[1], columns[0], columns[2:], head)
    with pytest.raises(InputError, match=f"t.csv: (row .: )?{told}"):
        read_unit(path, kind="pump")


@pytest.mark.parametrize("kind", ["pump", "motor"])
def test_swapped_efficiencies_are_named(tmp_path, kind):
    pair = efficiencies(SPEED, PRESSURE, kind)
    with pytest.raises(InputError, match="two columns swapped"):
        read_unit(table(tmp_path / "t.csv", SPEED, PRESSURE, pair[::-1]), kind=kind)
    again = np.repeat(5, 20)  # one point tells no slope
    assert (
        len(
            read_unit(
                table(
                    tmp_path / "t.csv",
                    SPEED[again],
                    PRESSURE[again],
                    [row[again] for row in pair],
                ),
                kind=kind,
            )
        )
        == 20
    )


@pytest.mark.parametrize(
    ("said", "given", "told"),
    [
        *(
            ("pump", {"noise": noise}, f"noise = {noise:g} .*1e-06 to 0.2")
            for noise in (float("nan"), 0.0, 5.0)
        ),  # no meter has it
        ("", {}, "kind is missing; needs one of pump, motor"),
        ("pump", {"kind": "motor"}, "kind is motor and pump"),
    ],
)
def test_kind_and_noise_are_checked(tmp_path, said, given, told):
    path = table(
        tmp_path / "t.csv",
        SPEED,
        PRESSURE,
        efficiencies(SPEED, PRESSURE),
        HEAD + ",kind" * bool(said),
        more=f",{said}" * bool(said),
    )
    with pytest.raises(InputError, match=told):
        read_unit(path, **given)


def reading(tmp_path, head, columns, kind="pump"):
    rows = [
        ",".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True)
    ]
    path = tmp_path / "t.csv"
    path.write_text("\n".join([head, *rows]) + "\n")
    return read_unit(path, kind=kind)


SIZE = np.full(len(SPEED), CM3)


@pytest.mark.parametrize("kind", ["pump", "motor"])
@pytest.mark.parametrize(
    "head",
    [
        "displacement_cm3,speed_rpm,pressure_bar,flow_L/min,torque_Nm",
        "displacement [cm3/rev],n [1/min],dp [bar],Q [L/min],M [Nm]",
        "Displacement (cc/rev),Drehzahl (1/min),Druck (bar),Volumenstrom (L/min),Drehmoment (Nm)",
    ],
)
def test_flow_and_torque_as_measured(tmp_path, kind, head):
    sign = 1.0 if kind == "pump" else -1.0
    w, p = SPEED * TURN / 60.0, PRESSURE * 1e5
    size = CM3 * 1e-6 / TURN
    lost = np.array([LEAKAGE * p, DAMPING * w + 0.01 * size * p])
    flow = (size * w - sign * lost[0]) * 6e4
    torque = size * p + sign * lost[1]
    found = reading(tmp_path, head, (SIZE, SPEED, PRESSURE, flow, torque), kind)
    np.testing.assert_allclose(found.losses, lost, rtol=1e-6, atol=1e-9)


def test_overall_with_volumetric_efficiency_cubic_inches_and_psi(tmp_path):
    volumetric, mechanical = efficiencies(SPEED, PRESSURE)
    first = read_unit(
        table(tmp_path / "a.csv", SPEED, PRESSURE, (volumetric, mechanical)),
        kind="pump",
    )
    psi = PRESSURE * 1e5 / 6894.757293168
    cubic = SIZE / 16.387064
    for name in ("overall_efficiency", "Gesamtwirkungsgrad", "total efficiency [-]"):
        head = f"displacement_in3,speed_rpm,pressure_psi,volumetric_efficiency,{name}"
        columns = (cubic, SPEED, psi, volumetric, volumetric * mechanical)
        found = reading(tmp_path, head, columns)
        np.testing.assert_allclose(found.losses, first.losses, rtol=5e-3, atol=3e-7)
    gallons = volumetric * SIZE * SPEED * 1e-6 / 60.0 / 6.30901964e-5
    head = "displacement_in3,speed_rpm,pressure_psi,flow_gpm,mechanical_efficiency"
    found = reading(tmp_path, head, (cubic, SPEED, psi, gallons, mechanical))
    np.testing.assert_allclose(found.losses, first.losses, rtol=5e-3, atol=3e-7)


def test_a_row_of_units_below_the_names(tmp_path):
    volumetric, mechanical = efficiencies(SPEED, PRESSURE)
    first = reading(tmp_path, HEAD, (SIZE, PRESSURE, SPEED, volumetric, mechanical))
    head = "displacement,pressure,speed,volumetric,mechanical\ncm3,bar,rpm,-,-"
    found = reading(tmp_path, head, (SIZE, PRESSURE, SPEED, volumetric, mechanical))
    np.testing.assert_array_equal(found.losses, first.losses)


@pytest.mark.parametrize("kind", ["pump", "motor"])
@pytest.mark.parametrize(
    ("name", "factor"),
    [("flow_L/min", 3.785), ("torque_Nm", 0.7376), ("overall_efficiency", 0.85)],
)
def test_flow_and_torque_agree_with_the_efficiencies(tmp_path, kind, name, factor):
    sign = 1.0 if kind == "pump" else -1.0
    volumetric, mechanical = efficiencies(SPEED, PRESSURE, kind)
    columns = {
        "displacement_cm3": SIZE,
        "speed_rpm": SPEED,
        "pressure_bar": PRESSURE,
        "flow_L/min": SIZE * SPEED / 1000.0 * volumetric**sign,
        "torque_Nm": SIZE * PRESSURE / 10.0 / TURN * mechanical**-sign,
        "volumetric_efficiency": volumetric,
        "mechanical_efficiency": mechanical,
        "overall_efficiency": volumetric * mechanical,
    }
    measured = dict(list(columns.items())[:5])
    first = reading(tmp_path, ",".join(measured), measured.values(), kind)
    both = reading(tmp_path, ",".join(columns), columns.values(), kind)
    np.testing.assert_allclose(both.losses, first.losses, rtol=1e-3, atol=1e-7)

    columns[name] = factor * columns[name]
    with pytest.raises(InputError, match=rf"{name.split('_')[0]}\w* is .* times that"):
        reading(tmp_path, ",".join(columns), columns.values(), kind)
