# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Reading of work cycles: units, gaps, and what is wrong in a file."""

import math

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.transmission.ranges import RPM
from hmcvt_tools.mission import CYCLES, Vehicle, load_vehicle, read_cycle
from hmcvt_tools.mission.vehicle import Limits
from mission.drive_lines import DRIVE, cycle, written


def test_units_behind_the_names(tmp_path):
    header = "time [min],output_speed [rpm],output_power [kW],pto_power [kW]"
    text = f"{header}\n0,600,20,5\n1,600,20,5\n"
    read = read_cycle(written(tmp_path, text))
    assert len(read) == 120
    assert read.output_speed[0] == pytest.approx(600 * RPM)
    assert read.output_power[-1] == 20e3
    assert read.pto_power[-1] == 5e3


def test_demand_at_the_ground(tmp_path):
    vehicle = Vehicle(mass=5000.0, rolling_resistance=0.1, slip=0.1)
    text = "time,ground_speed [km/h],drawbar_force [kN]\n" + "".join(
        f"{i},7.2,10\n" for i in range(5)
    )
    read = read_cycle(written(tmp_path, text), vehicle)
    pull = 2.0 * (10e3 + 0.1 * 5000.0 * 9.81)
    assert read.output_power == pytest.approx(np.full(5, pull / 0.9 / 0.97))
    assert sum(read.ground.values()) == pytest.approx(read.output_power)
    assert read.output_speed[0] == pytest.approx(2.0 / 0.9 / 0.85 * 21.0)


def test_brakes_take_a_negative_demand(tmp_path):
    rows = [(8.0, 20e3), (8.0, 20e3), (4.0, -9e3), (0.0, 0.0)]
    read = cycle(tmp_path, "ground_speed,drawbar_force", *rows)
    assert (read.output_power >= 0.0).all()
    assert sum(read.ground.values()) == pytest.approx(read.output_power)
    assert read.ground["brakes"][2] > 0.0
    assert "the demand is negative at 2 steps, first at 2 s" in read.remarks[0]


def test_gaps_and_empty_cells_are_left_out_and_named(tmp_path):
    rows = [f"{t},60,20e3" for t in (0, 1, 2, 3, 20, 21, 22)]
    text = "time,output_speed,output_power\n" + "\n".join(rows)
    read = read_cycle(written(tmp_path, text))
    assert read.known.sum() == 7 and len(read) == 23
    assert read.remarks[0] == "4 s to 20 s: no rows; left out"
    read = cycle(tmp_path, "output_speed,output_power", (60, 2e4), ("", 2e4), (60, 2e4))
    assert read.known.tolist() == [True, False, True]
    assert "1 steps miss a value, first at 1 s" in read.remarks[0]


def test_fine_rows_are_averaged(tmp_path):
    rows = "".join(f"{i / 10},60,{1e4 + 100 * i}\n" for i in range(40))
    read = read_cycle(written(tmp_path, "time,output_speed,output_power\n" + rows))
    assert read.output_power == pytest.approx(
        1e4 + 100 * np.array([4.5, 14.5, 24.5, 34.5])
    )


def test_a_series_of_estimate_is_a_cycle(tmp_path):
    text = "stamp,stage,output_torque,output_power\n0,HM2,500,30000\n1,HM2,0,0\n2,HM2,500,30000\n"
    read = read_cycle(written(tmp_path, text))
    assert read.output_speed.tolist() == [60.0, 0.0, 60.0]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("time,output_speed\n0,1\n1,1\n", "needs the columns time, output_speed or"),
        (
            "time,output_speed,output_power\n0,60,1\n0,60,1\n",
            "row 3: time = 0 s does not rise",
        ),
        ("time,output_speed,output_power\n0,60,1\n1,x,1\n", "row 3"),
        (
            "time,output_speed,output_power\n0,60,1\n1,6e4,1\n",
            "row 3: output_speed = 60000",
        ),
        (
            "time,output_speed [mph],output_power\n0,60,1\n1,60,1\n",
            "'mph' is no unit of",
        ),
        (
            "time,output_speed,drawbar_force\n0,60,1\n1,60,1\n",
            "needs the column ground_speed",
        ),
        ("time,output_speed,output_power\n0,60,1\n", "one row is no cycle"),
        (
            "time,output_speed,output_power\n0,6,1\n1e6,6,1\n",
            "give a longer step, or cut it",
        ),
        (
            "time,ground_speed,output_power,drawbar_force\n0,6,1,1\n1,6,1,1\n",
            "both state the load",
        ),
    ],
)
def test_bad_files_are_refused(tmp_path, text, complaint):
    with pytest.raises(hmcvt.InputError, match=complaint):
        read_cycle(written(tmp_path, text))


@pytest.mark.parametrize("name", CYCLES)
def test_shipped_cycles_are_complete(name):
    read = read_cycle(name, DRIVE.vehicle)
    assert len(read) == 1200 and read.known.all()


def test_vehicle_files_are_checked(tmp_path):
    path = tmp_path / "v.yaml"
    path.write_text("schema: hmcvt-vehicle/1\nmass: {value: 7.5, unit: N}\n")
    with pytest.raises(hmcvt.InputError, match=r"mass\.unit = 'N'; needs 'kg'"):
        load_vehicle(path)
    path.write_text("schema: hmcvt-vehicle/1\nlimits: {gear: 1}\n")
    with pytest.raises(hmcvt.InputError, match=r"limits\.gear"):
        load_vehicle(path)
    path.write_text("schema: hmcvt-vehicle/1\nmass: 6000\n")
    assert load_vehicle(path) == Vehicle(mass=6000.0)
    assert load_vehicle(hmcvt.data_path("params/vehicle.yaml")) == Vehicle()


@pytest.mark.parametrize("wrong", ["0.08", True, math.nan, 8.0, -0.1])
def test_vehicles_in_python_are_checked(wrong):
    with pytest.raises(hmcvt.InputError, match="vehicle: slip = "):
        Vehicle(slip=wrong)
    with pytest.raises(hmcvt.InputError, match="limits: torque_reserve = "):
        Limits(torque_reserve=wrong)


def test_speeds_of_a_vehicle_in_python_are_in_si():
    assert Vehicle(pto_speed_high=3000.0 * RPM).pto_speed_high == 3000.0 * RPM
    with pytest.raises(hmcvt.InputError, match=r"outside 10\.472 to 314\.159 rad/s"):
        Vehicle(pto_speed_high=2050.0)
    with pytest.raises(hmcvt.InputError, match="engine_speed_low = 2300 r/min is not"):
        Limits(engine_speed_low=2300.0 * RPM)


@pytest.mark.parametrize("step", [1201.0, math.inf])
def test_a_step_longer_than_the_cycle_is_refused(step):
    with pytest.raises(hmcvt.InputError, match="is longer than the cycle, 1200 s"):
        read_cycle("sowing", step=step)


def test_other_units_of_a_vehicle_file(tmp_path):
    path = tmp_path / "v.yaml"
    path.write_text(
        "schema: hmcvt-vehicle/1\nmass: {value: 7.5, unit: t}\n"
        "tyre_radius: {value: 850, unit: mm}\nslip: {value: 8, unit: '%'}\n"
        "pto_speed_low: {value: 1850, unit: rpm}\n"
    )
    read = load_vehicle(path)
    assert read.mass == 7500.0
    assert read.tyre_radius == pytest.approx(0.85)
    assert read.slip == pytest.approx(0.08)
    assert read.pto_speed_low == pytest.approx(1850.0 * np.pi / 30.0)
