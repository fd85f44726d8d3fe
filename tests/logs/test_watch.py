# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt watch` on the bus of a machine: no drift, and fuel or slip that drift."""

import json

import numpy as np
import pytest
from cli.running import run

import hmcvt_core as hmcvt
from hmcvt_tools.estimation.bus_watch import Windows, compare
from studies.road.scoring import well_known

RESOLUTION = {
    "engine_torque": 8.0,
    "fuel_rate": 0.05 * 0.832 / 3600.0,
    "output_speed": 0.0131,
    "displacement_ratio": 0.004,
}


def windows(seed, count=150, fuel=0.0, slip=0.0, since=60):
    """Means of windows in stage HM3, with a bias of torque, fuel and stroke of their bus."""
    rng = np.random.default_rng(seed)
    model = well_known().stages["HM3"]
    engine = hmcvt.load_engine(hmcvt.data_path("params/engine.yaml"))
    stroke = rng.uniform(-0.8, 0.8, count)
    speed = rng.uniform(120.0, 200.0, count)
    load = rng.uniform(150.0, 400.0, count)
    torque = load / model.efficiency(stroke, speed, load)
    output = model.output_speed(stroke, speed, load)
    late = np.arange(count) >= since
    rate = engine.fuel_rate(speed, torque) * (1.0 + rng.normal(0.0, 0.03))
    rate = rate * (1.0 + fuel * late)
    output = output * (1.0 - slip * late)
    torque = torque * (1.0 + rng.normal(0.0, 0.02))

    def rounded(values, name):
        return np.round(values / RESOLUTION[name]) * RESOLUTION[name]

    return Windows(
        np.arange(count) * 60.0,
        speed,
        rounded(torque, "engine_torque"),
        rounded(output, "output_speed"),
        rounded(rate, "fuel_rate"),
        rounded(stroke + rng.normal(0.0, 0.005), "displacement_ratio"),
    )


def drifts(*arguments, **options):
    engine = hmcvt.load_engine(hmcvt.data_path("params/engine.yaml"))
    found = compare(windows(*arguments, **options), RESOLUTION, well_known(), engine)
    return {drift.name: drift for drift in found}


def test_no_false_alarms():
    alarms = [any(d.open for d in drifts(seed).values()) for seed in range(40)]
    assert sum(alarms) <= 2


@pytest.mark.parametrize(
    ("name", "options", "size"),
    [
        ("fuel", {"fuel": 0.05}, 0.05),
        ("fuel", {"fuel": -0.05}, -0.05),
        ("output_speed", {"slip": 0.02}, -0.02),
    ],
)
def test_a_drift_is_noticed(name, options, size):
    found = [drifts(seed, **options)[name] for seed in range(8)]
    assert sum(drift.open for drift in found) >= 7
    opened = [drift for drift in found if drift.open]
    assert all(drift.noticed > 60 for drift in opened)
    sizes = [drift.size for drift in opened]
    assert np.median(sizes) == pytest.approx(size, rel=0.25)


def test_on_a_log(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    steady = windows(1, count=40, fuel=0.12, since=15)
    time = np.arange(40 * 80) * 0.1
    mdf = asammdf.MDF(version="4.10")
    rpm = np.pi / 30.0
    for name, column, unit, size in (
        ("EngineSpeed", steady.engine_speed, "rpm", rpm),
        ("EngineTorque", steady.engine_torque, "Nm", 1.0),
        ("OutputShaftSpeed", steady.output_speed, "rpm", rpm),
        ("FuelRate", steady.fuel_rate, "kg/h", 1.0 / 3600.0),
    ):
        values = np.repeat(column / size, 80)
        mdf.append(asammdf.Signal(values, time, name=name, unit=unit))
    path = tmp_path / "drive.mf4"
    mdf.save(path, overwrite=True)
    mdf.close()
    engine = ("--engine", hmcvt.data_path("params/engine.yaml"))
    params = ("--params", hmcvt.data_path("params/tractor.yaml"))
    done = run("watch", path, *params, *engine, "--json")
    assert done.code == 4, done.err
    answer = json.loads(done.out)
    (drift,) = answer["drifts"]
    assert drift["name"] == "fuel" and drift["size"] == pytest.approx(0.12, abs=0.03)
    done = run("watch", path, *params, *engine)
    assert "within what a bus can tell" in done.out
    done = run("watch", path, *params)
    assert done.code == 2 and "--engine" in done.err
