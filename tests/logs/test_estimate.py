# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt estimate` on the bus of a simulated tractor."""

import csv
import json

import numpy as np
import pytest
from cli.running import run

import hmcvt_core as hmcvt
import hmcvt_tools
from studies.road.bus import MAKER, Faults, encode, in_order
from studies.road.conditions import Condition, scores_in
from studies.road.drive import drive, machine_of
from studies.road.scoring import scored, well_known

can = pytest.importorskip("can")
pytest.importorskip("cantools")

SECONDS = 60.0
SERIES = (
    *("stamp", "stage", "displacement_ratio", "engine_speed", "output_torque"),
    *("output_torque_low", "output_torque_high", "output_power", "power_loss"),
    "efficiency",
)


@pytest.fixture(scope="module")
def driven():
    rng = np.random.default_rng(3)
    machine = machine_of(well_known(), rng)
    return machine, drive(machine, SECONDS, rng)


@pytest.fixture(scope="module")
def recorded(driven, tmp_path_factory):
    """A trace recorded from a virtual bus, with stamps as sent at the rates of J1939."""
    machine, drove = driven
    folder = tmp_path_factory.mktemp("bus")
    messages = encode(drove, machine, Faults(0.0, (0.0, 0.0, 0.0, 0.0)), True)
    options = {"interface": "virtual", "channel": "hmcvt", "preserve_timestamps": True}
    with (
        can.Bus(**options) as sender,
        can.Bus(**options) as receiver,
        can.Logger(str(folder / "drive.blf")) as log,
        can.Logger(str(folder / "drive.log")) as candump,
    ):
        for time, identifier, data in in_order(messages):
            sender.send(
                can.Message(
                    timestamp=1.7e9 + time,
                    arbitration_id=identifier,
                    is_extended_id=True,
                    data=data,
                )
            )
            received = receiver.recv(1.0)
            log(received)
            candump(received)
    (folder / "maker.dbc").write_text(MAKER)
    return folder


def test_from_a_virtual_bus(recorded):
    out = recorded / "series.csv"
    done = run(
        *("estimate", recorded / "drive.blf", "--dbc", recorded / "maker.dbc"),
        *("--params", hmcvt.data_path("params/tractor.yaml"), "--out", out),
        *("--engine", hmcvt.data_path("params/engine.yaml"), "--json"),
        *("--map", recorded / "map.csv", "--picture", recorded / "map.png"),
    )
    assert done.code == 0, done.err
    answer = json.loads(done.out)
    assert answer["seconds"] == pytest.approx(SECONDS, abs=0.5)
    assert answer["coverage"] > 0.95
    energy = answer["energy"]
    assert energy["engine"] == pytest.approx(energy["output"] + energy["lost"])
    low, high = answer["output_interval"]
    assert low < energy["output"] < high
    assert answer["fuel"] > 0.0
    assert sum(answer["stages"].values()) == pytest.approx(
        answer["coverage"] * answer["seconds"]
    )
    weights = [row["weight"] for row in answer["map"]]
    assert sum(weights) == pytest.approx(1.0)
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == SERIES
    assert len(rows) == pytest.approx(10 * SECONDS, abs=10)
    assert (recorded / "map.png").stat().st_size > 0


@pytest.mark.parametrize("with_unit", [True, False])
def test_error_and_interval(driven, tmp_path, with_unit):
    machine, drove = driven
    score = scored(
        tmp_path,
        well_known(),
        machine,
        drove,
        Faults(0.01, (0.01, 0.03, 0.05, 0.02)),
        with_unit,
    )
    assert np.median(score.slow) < 0.05
    assert score.slow_inside.mean() > 0.8
    assert score.stage_right.mean() > 0.97
    assert abs(score.energy) < 0.06 and score.energy_inside
    assert score.coverage > 0.95


def test_wrong_stage_near_the_ratio_where_two_meet():
    """Half of this drive is near full stroke of HM3, and the bus names HM4.

    Intervals of HM4 alone held 1 % of the true powers there.
    """
    right, wrong = (
        scores_in(Condition("", wrong_stage=named), [1], 1.0)[0]
        for named in (False, True)
    )
    assert right.coverage > 0.98
    assert wrong.coverage < 0.5
    assert wrong.slow_inside.mean() > 0.8


@pytest.mark.parametrize(("seed", "coverage"), [(2043, 0.3), (2045, 0.5)])
def test_wrong_stage_where_slip_is_large(seed, coverage):
    """Leakage at the upper end of its error, at full load: intervals of HM4 held none."""
    (wrong,) = scores_in(Condition("", wrong_stage=True), [seed], 0.6)
    assert wrong.coverage < coverage
    assert len(wrong.slow) == 0 or wrong.slow_inside.mean() > 0.8


def test_candump_gives_the_same(recorded):
    model = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    dbc = recorded / "maker.dbc"
    one = hmcvt_tools.estimate(recorded / "drive.blf", model, dbc=dbc).to_dict()
    other = hmcvt_tools.estimate(recorded / "drive.log", model, dbc=dbc).to_dict()
    assert one["energy"]["output"] == pytest.approx(other["energy"]["output"], rel=1e-6)


def test_a_fleet_of_logs(recorded):
    params = ("--params", hmcvt.data_path("params/tractor.yaml"))
    broken = recorded / "fleet" / "broken.blf"
    broken.parent.mkdir()
    broken.write_bytes(b"no trace")
    for name in ("a.log", "b.log"):
        (broken.parent / name).write_bytes((recorded / "drive.log").read_bytes())
    done = run("estimate", broken.parent, *params, "--json", "--processes", 2)
    assert done.code == 3
    answer = json.loads(done.out)
    assert answer["seconds"] == pytest.approx(2.0 * SECONDS, abs=1.0)
    assert len(answer["broken"]) == 1 and "broken.blf" in answer["broken"][0]
    # What both say is said once.
    assert len(answer["notes"]) == len(set(answer["notes"])) > 0
    for note in answer["notes"]:
        assert note.startswith("2 logs, ") and "a.log to " in note


def test_fuel_where_no_torque_is_known(driven, tmp_path):
    """An MDF log of engine speed, fuel and output speed."""
    asammdf = pytest.importorskip("asammdf")
    _, drove = driven
    engine = hmcvt.load_engine(hmcvt.data_path("params/engine.yaml"))
    rows = slice(None, None, 10)
    full = engine.full_load_torque(drove.engine_speed[rows])
    torque = np.clip(np.nan_to_num(drove.engine_torque[rows]), 0.0, full)
    fuel = 3600.0 * engine.fuel_rate(drove.engine_speed[rows], torque)
    mdf = asammdf.MDF(version="4.10")
    rpm = np.pi / 30.0
    for name, values, unit in (
        ("EngineSpeed", drove.engine_speed[rows] / rpm, "rpm"),
        ("OutputShaftSpeed", drove.output_speed[rows] / rpm, "rpm"),
        ("FuelRate", fuel, "kg/h"),
    ):
        mdf.append(asammdf.Signal(values, drove.time[rows], name=name, unit=unit))
    path = tmp_path / "drive.mf4"
    mdf.save(path, overwrite=True)
    mdf.close()
    model = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    result = hmcvt_tools.estimate(path, model, engine)
    true = np.nansum(drove.output_power) / 100.0
    assert result.totals.output == pytest.approx(true, rel=0.08)
    assert any("fuel rate" in note for note in result.notes)
    with pytest.raises(hmcvt.InputError, match="needs --engine"):
        hmcvt_tools.estimate(path, model)
