# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Every layout, either way, at any load: by hand, by a second solution, by its balance."""

from dataclasses import replace
from math import copysign, prod

import numpy as np
import pytest
from scipy.optimize import fsolve

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.mechanical import ChargePump, ClutchDrag, PlanetaryMesh
from hmcvt_core.transmission.ranges import OperatingPoints
from hmcvt_core.transmission.stage import speed_ratio

FILES = ("tractor", "output_coupled", "hydrostatic")
STAGES = {f"{file} {name}": model for file in FILES for name, model in
          hmcvt.load_model(hmcvt.data_path(f"params/{file}.yaml")).stages.items()}
# HM4 with its output turned round, and with a pump so large that the output passes standstill.
HM4 = STAGES["tractor HM4"]
STAGES["HM4 back"] = replace(HM4, stage=replace(
    HM4.stage, reverse=True, output=replace(HM4.stage.output, direction=-1)))
STAGES["HM4 through zero"] = replace(HM4, stage=replace(HM4.stage, pump_motor=replace(
    HM4.stage.pump_motor, pump_displacement=3.5e-5)))
every_stage = pytest.mark.parametrize("name", STAGES)


def test_speed_ratios_by_hand():
    # Ring 2, carrier 1, sun n: 2 n_ring = 3 - n_sun; the pump turns n_ring / 0.75, half the size
    # of a motor that turns n_sun / (1 / 0.6667): 0.5 eps (1.5 - 0.5 n) / 0.75 = 0.6667 n.
    def forward(eps):
        return eps / (0.6667 + eps / 3.0)

    def reverse(eps):  # pair R between sun and output, both turned back; a positive stroke too
        return -eps / (0.6667 + 1.2 * eps / 3.0)

    def hm1(eps):  # ring 1 / i1, sun -eps / (i4 i5), carrier = (k ring + sun) / (1 + k)
        return (3.56 / 1.439 - eps / (0.678 * 1.96)) / 4.56 / (0.982 * 3.52 * 0.794 * 1.093)

    for name, by_hand in (("output_coupled forward", forward), ("output_coupled reverse", reverse),
                          ("hydrostatic H", lambda eps: eps / (0.8 * 1.5 * 2.0)),
                          ("tractor HM1", hm1),
                          ("tractor H0", lambda eps:
                           eps / (0.678 * 1.96 * 0.982 * 2.767 * 0.794 * 2.767))):
        for eps in (-0.4, 0.3, 1.0):
            found = speed_ratio(STAGES[name].stage, np.array([eps]))[0]
            assert found == pytest.approx(by_hand(eps), rel=1e-12), name


def test_adjacent_stages_of_the_tractor_meet():
    ratio = {name: speed_ratio(STAGES[f"tractor {name}"].stage, np.array([-1.0, 1.0]))
             for name in ("H0", "HM1", "HM2", "HM3", "HM4")}
    misses = [ratio[low][end] / ratio[high][end] - 1.0 for low, high, end in (
        ("H0", "HM1", 1), ("HM1", "HM2", 0), ("HM2", "HM3", 1), ("HM3", "HM4", 0))]
    np.testing.assert_allclose(misses, [0.0017, -0.0031, 0.0007, -0.0031], atol=5e-5)


@every_stage
def test_balance_closes_at_any_load(name):
    model, rng = STAGES[name], np.random.default_rng(1)
    stroke, speed, torque = (rng.uniform(*ends, 10_000) for ends in (
        (-1.0, 1.0), (78.0, 230.0), (-300.0, 300.0)))
    torque[:500] = 0.0
    watts = model.breakdown(stroke, speed, torque)
    efficiency, output, engine = model.solution_at(OperatingPoints(stroke, speed, torque))
    lost = model.power_loss(stroke, speed, torque)
    carried = np.isfinite(engine)
    assert carried[torque <= 0.0].all() and carried.mean() > 0.5
    np.testing.assert_array_equal(np.isfinite(watts.input_power), carried)
    scale = sum(np.abs(part) for part in watts.losses.values()) + np.abs(watts.input_power)
    gap = watts.input_power - watts.output_power - sum(watts.losses.values())
    assert np.nanmax(np.abs(gap) / scale) < 1e-9
    assert min(np.nanmin(part / scale) for part in watts.losses.values()) > -1e-9
    assert np.nanmax(np.abs(lost - watts.input_power + watts.output_power) / scale) < 1e-9
    told = np.isfinite(efficiency) & (torque != 0.0)
    assert ((efficiency[told] > 0.0) & (efficiency[told] < 1.0)).all()
    # In overrun it is engine power / output power, where the wheels turn the engine alone.
    back = (torque < 0.0) & (engine < 0.0)
    np.testing.assert_allclose(efficiency[back], engine[back] / torque[back], rtol=1e-12)
    assert np.isnan(efficiency[(torque < 0.0) & (engine > 0.0)]).all()
    moving = carried & (torque > 0.0) & (np.abs(speed_ratio(model.stage, stroke)) > 0.25 * (
        np.abs(speed_ratio(model.stage, np.array([-1.0, 1.0]))).max()))
    assert (output * speed_ratio(model.stage, stroke))[moving].min() > 0.0
    if model._point_solver is not None:
        single = [model._point_solver.solve(*point) for point in
                  zip(stroke[:3000].tolist(), speed.tolist(), torque.tolist(), strict=False)]
        np.testing.assert_array_equal(np.transpose(single), [
            column[:3000] for column in (efficiency, output, engine)])


@every_stage
def test_loss_has_no_jump_at_zero_load(name):
    model = STAGES[name]
    for stroke in (-0.83, 0.41, 1.0):
        below, at, above = model.power_loss(stroke, 150.0, np.array([-1e-7, 0.0, 1e-7]))
        assert at > 0.0
        np.testing.assert_allclose([below, above], at, rtol=1e-6)


@every_stage
def test_agrees_with_a_second_solution(name):
    """Shafts, row, gears and units by their own laws, handed to fsolve; pull and overrun."""
    model, rng = STAGES[name], np.random.default_rng(2)
    checked = 0
    for stroke, speed, torque in zip(rng.uniform(-1, 1, 60), rng.uniform(80, 220, 60),
                                     rng.uniform(-250, 250, 60), strict=True):
        point = (float(stroke), float(speed), float(torque))
        _, output, engine = (column[0] for column in model.solution_at(
            OperatingPoints(*np.atleast_2d(point).T)))
        if not np.isfinite(engine) or abs(output) < 0.05 * speed:
            continue
        found, given = _second_solution(model, *point, output)
        if found is None:  # friction holds the motor
            continue
        checked += 1
        assert output == pytest.approx(found, rel=1e-7)
        assert engine == pytest.approx(given, rel=1e-6, abs=1e-4)
    assert checked > 15


def _second_solution(model, eps, engine_speed, load_torque, near):
    stage, found, units = model.stage, model.parameters, model.stage.pump_motor
    v_p, v_m = units.pump_displacement, units.motor_displacement
    row = {"sun": 1.0, "ring": stage.planetary_constant, "carrier": -1.0 - stage.planetary_constant}
    i, eta = ({path: function(getattr(stage, path)) for path in stage.paths} for function in (
        lambda path: path.direction * prod(pair.ratio for pair in path.gear_pairs),
        lambda path: prod(pair.efficiency for pair in path.gear_pairs)))

    def passed(path, torque, speed):
        """Torque beyond a path, not yet geared, of one that is put in."""
        return torque * eta[path] ** copysign(1.0, torque * speed)

    def third(first, second, a, b):
        """Speed of the member that is left."""
        left = ({"sun", "ring", "carrier"} - {a, b}).pop()
        return -(row[a] * first + row[b] * second) / row[left]

    engine, held, out = stage.mechanical_member, stage.motor_member, stage.output_member

    def state(x):
        output, pressure = x[0] * near, x[1] * 1e6
        if stage.layout == "input_coupled":
            pump = engine_speed / i["pump"]
            motor = third(engine_speed / i["mechanical"], output * i["output"], engine, out) * (
                i["motor"])
        elif stage.layout == "hydrostatic":
            pump, motor = engine_speed / i["pump"], output * i["output"] * i["motor"]
        else:
            member = third(engine_speed / i["mechanical"], output * i["output"], engine, out)
            sense = copysign(1.0, -row[engine] / row[held] / i["mechanical"])
            pump, motor = sense * member / i["pump"], output * i["motor"]
        rubbing = np.sign(motor) * units.motor_friction * abs(pressure) * v_m
        motor_torque = pressure * v_m - found.motor_damping * motor - rubbing
        rubbing = np.sign(pump) * units.pump_friction * abs(pressure * eps) * v_p
        pump_torque = pressure * eps * v_p + found.pump_damping * pump + rubbing
        flow = v_p * pump * eps - v_m * motor - found.leakage * pressure
        from_motor = passed("motor", motor_torque, motor) * i["motor"]
        to_pump = -passed("pump", -pump_torque, pump) / i["pump"]
        if stage.layout == "output_coupled":
            torque = -sense * to_pump * i["pump"] / i["pump"]  # of the pump on the row
            share = torque / row[held]
            given = passed("output", -share * row[out], output * i["output"]) * i["output"]
            taken = -passed("mechanical", -share * row[engine] / i["mechanical"], engine_speed)
            return flow, from_motor + given, taken
        if stage.layout == "hydrostatic":
            given, taken = from_motor, 0.0
        else:
            share = from_motor / row[held]
            given, taken = -share * row[out], share * row[engine] / i["mechanical"]
            taken = -passed("mechanical", -taken, engine_speed)
        at_output = passed("output", given, output * i["output"]) * i["output"]
        return flow, at_output, taken + to_pump

    def laws(x):
        flow, at_output, _ = state(x)
        return (flow / (v_m * engine_speed), at_output * x[0] * near / engine_speed - load_torque)

    for pressure in (1.0, -1.0, 20.0, -20.0, 80.0, -80.0):
        x, _, done, _ = fsolve(laws, [1.0, pressure], full_output=True, xtol=1e-13)
        if done == 1 and max(map(abs, laws(x))) < 1e-7 and abs(x[0] - 1.0) < 0.5:
            return x[0] * near, state(x)[2]
    return None, None


@pytest.mark.parametrize("effect", [ChargePump(5.0), ClutchDrag(6.0), PlanetaryMesh(0.03)])
@every_stage
def test_effects_cost_power_in_every_layout(name, effect):
    model = STAGES[name]
    worse, rng = replace(model, effects=(effect,)), np.random.default_rng(3)
    points = [rng.uniform(*ends, 500) for ends in ((0.3, 1.0), (80.0, 220.0), (-200.0, 150.0))]
    more = worse.power_loss(*points) - model.power_loss(*points)
    if not model.stage.has_row and effect.name == "planetary_mesh":
        assert np.nanmax(np.abs(more)) < 1e-6
    else:
        assert np.nanmedian(more) > 1.0 and np.isfinite(more).mean() > 0.6


@pytest.mark.parametrize(("file", "old", "new", "message"), [
    ("output_coupled", "      reverse: true\n", "", "standing pump = -2.5 .*reverse: true"),
    ("output_coupled", "layout: output_coupled", "layout: both", "layout = 'both' is not allowed"),
    ("output_coupled", "motor: {gear_pairs: [M]}", "motor: {gear_pairs: [M], member: sun}",
     r"motor\.member = 'given' is not allowed"),
    ("output_coupled", ", member: ring", "", r"stages\.forward\.pump\.member is missing"),
    ("hydrostatic", "layout: hydrostatic", "layout: hydrostatic\n      reverse: true",
     "a hydrostatic stage turns either way"),
    ("hydrostatic", "pump: {gear_pairs: [P]}", "pump: {gear_pairs: [P]}\n      mechanical: {}",
     "a hydrostatic stage has no mechanical path"),
    ("tractor", "gear_pairs: [6, 11], member", "gear_pairs: [6, 11], direction: -1, member",
     "stage HM4: output speed per engine speed at standing motor = -1.19.*check the directions"),
    ("tractor", "    HM2:\n", "    HM2:\n      clutch: c2\n",
     r"HM2\.clutch at line \d+ is not known"),
    ("tractor", "[0.4147, 0.6534]", "0.4", r"HM4\.open_clutches = .*allowed: name: \[slip per"),
])
def test_wrong_stages_are_refused_by_name(tmp_path, file, old, new, message):
    text = hmcvt.data_path(f"params/{file}.yaml").read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "model.yaml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(hmcvt.InputError, match=message):
        hmcvt.load_model(path)


@pytest.mark.parametrize("file", FILES)
def test_files_of_several_stages_survive_saving(tmp_path, file):
    model = hmcvt.load_model(hmcvt.data_path(f"params/{file}.yaml"))
    hmcvt.save_model(model, tmp_path / "again.yaml")
    again = hmcvt.load_model(tmp_path / "again.yaml")
    assert list(again.stages) == list(model.stages) and again.fingerprint == model.fingerprint
    for name, stage in model.stages.items():
        point = (0.6, 170.0, 40.0)
        assert again.stages[name].efficiency(*point) == stage.efficiency(*point)
        assert model.efficiency(*point, stage=name) == stage.efficiency(*point)
    names = np.array(list(model.stages))[[0, -1, 0]]
    np.testing.assert_array_equal(
        model.efficiency(0.6, 170.0, 40.0, stage=names),
        [model.stages[name].efficiency([0.6], 170.0, 40.0)[0] for name in names])
    with pytest.raises(hmcvt.InputError, match="stage 'HM9' is not known to the model; there is"):
        model.efficiency(0.6, 170.0, 40.0, stage="HM9")
