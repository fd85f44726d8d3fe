# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A pump or motor through the diagnosis, and from there into a transmission."""

import gc
from dataclasses import dataclass, replace

import numpy as np
import pytest
from cli.running import assert_refused

from hmcvt_core import InputError, load_model
from hmcvt_core.benches.unit import (
    FRICTION,
    HydrostaticUnit,
    UnitModel,
    diagnose_unit,
    observe_unit,
    put_into,
)
from hmcvt_core.diagnosis.fitting.hypothesis import Hypothesis
from hmcvt_core.diagnosis.fitting.refit import refit
from hmcvt_core.files import data_path
from hmcvt_core.identification.prior import Prior
from hmcvt_core.model.parameter_file import save_model
from hmcvt_core.physics.balance import BalanceSolver
from hmcvt_core.physics.effects import effect_from_mapping, effect_to_mapping
from hmcvt_core.physics.effects.actuator import DisplacementGain
from hmcvt_core.physics.effects.hydraulic import OilTemperature
from hmcvt_core.physics.effects.mechanical import ChargePump, ConstantTorque
from hmcvt_core.transmission.parameters import HydraulicParameters
from hmcvt_core.transmission.ranges import OperatingPoints
from hmcvt_tools.tables.unit_table import read_unit
from studies.units.simulate import simulated

from .bench import CM3, DAMPING, LEAKAGE, TURN, efficiencies, grid, table

pytestmark = pytest.mark.slow

SPEED, PRESSURE = grid(5)


def pump(tmp_path, **hidden):
    rng = np.random.default_rng(1)
    pair = [
        each * (1.0 + 0.001 * rng.standard_normal(len(each)))
        for each in efficiencies(SPEED, PRESSURE, **hidden)
    ]
    return table(
        tmp_path / "pump.csv", SPEED, PRESSURE, pair, cm3=hidden.get("cm3", CM3)
    )


def test_terms_of_the_paper(tmp_path):
    found = diagnose_unit(read_unit(pump(tmp_path), kind="pump"))
    assert found.diagnosis.verdict == "no_gap"
    assert found.model.parameters["leakage"] == pytest.approx(LEAKAGE, rel=0.1)
    assert found.model.parameters["damping"] == pytest.approx(DAMPING, rel=0.1)
    assert found.model.friction == pytest.approx(FRICTION, rel=0.1)
    assert found.same is None


@pytest.mark.parametrize(
    ("names", "seed"),
    [
        pytest.param(("compressibility",), 6, marks=pytest.mark.long),
        pytest.param(("pressure_leakage",), 7, marks=pytest.mark.long),
        pytest.param(("reference_displacement",), 6, marks=pytest.mark.long),
        (("constant_torque", "orifice_leakage"), 7),
    ],
    ids=lambda each: "+".join(each) if isinstance(each, tuple) else str(each),
)
def test_hidden_effect_leads(names, seed):
    found = diagnose_unit(simulated(names, seed), deals=False)
    assert found.diagnosis.sets[0].effects == names
    assert found.diagnosis.verdict in ("cause_found", "ambiguous")
    for row in found.rmse.values():
        assert row["with_effects"] < 1.05 * row["base"]
    if names == ("reference_displacement",):
        assert found.diagnosis.component == "sensor"
        assert "displacement stated is +" in found.diagnosis.warnings[0]


def test_displacement_in_doubt(tmp_path):
    # The torque is that of 2.5 % less displacement, the flow is not: no one displacement has both.
    ideal = CM3 * 1e-6 / TURN * PRESSURE * 1e5
    found = diagnose_unit(
        read_unit(pump(tmp_path, torque=4.0 - 0.025 * ideal), kind="pump")
    )
    assert (
        "in doubt" in found.diagnosis.warnings[0]
        and "in doubt" in found.to_dict()["notes"][0]
    )
    assert (
        found.diagnosis.verdict == "unexplained" and found.diagnosis.component is None
    )


@pytest.fixture
def two_deals(monkeypatch):
    """Repeat the search twice, not eight times: tests of what is printed need no more."""
    monkeypatch.setattr("hmcvt_core.benches.unit.diagnosis.DEALS", 2)


@pytest.mark.usefixtures("two_deals")
def test_holdout_of_a_table(tmp_path, hmcvt):
    path = pump(tmp_path, flow=1.2e-12 * (PRESSURE * 1e5) * SPEED / 1500.0)
    data = hmcvt(
        "unit", path, "--kind", "pump", "--above", "pressure=0.7", "--json"
    ).json
    assert data["shrinkage"]["on"] == "holdout" and data["shrinkage"]["fraction"] > 0.6
    assert data["component"] == "oil"
    assert set(data["rmse"]) == {"flow", "torque"}
    flow = data["rmse"]["flow"]
    assert flow["holdout_with_effects"] < 0.4 * flow["holdout_base"]
    assert all(
        {"pressure", "speed", "displacement_ratio"} <= set(place)
        for place in data["where"]
    )
    assert data["where"][0]["displacement_ratio"] == [1.0, 1.0]
    assert set(data["parameters"]) == {"leakage", "damping", "friction"}
    assert 0 <= data["same_set_in_deals"] <= 2


@pytest.mark.usefixtures("coarse_maps", "two_deals")
def test_text_and_page(tmp_path, hmcvt):
    page = tmp_path / "page.html"
    done = hmcvt("unit", pump(tmp_path, torque=6.0), "--kind", "pump", "--report", page)
    assert "constant_torque" in done.out and "rms left by the paper's terms" in done.out
    html = page.read_text()
    assert "What the terms leave" in html and "pressure [bar]" in html
    assert "engine" not in html and "efficiency" not in html
    assert "constant torque" in html


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (
            ("--above", "load=0.7"),
            "'load' is none of displacement_ratio, speed, pressure",
        ),
        (("--above", "pressure=0.01"), "0.01 of the highest pressure parts no samples"),
        (("--noise", "5"), "noise = 5 is outside 1e-06 to 0.2"),
        (("--unit", "X", "--kind", "gear"), "--kind"),
    ],
)
def test_bad_options_are_named(tmp_path, hmcvt, arguments, told):
    done = hmcvt("unit", pump(tmp_path), "--kind", "pump", *arguments)
    assert_refused(done, told)


@pytest.mark.long
def test_leakage_falling_with_speed(tmp_path):
    speed, pressure = grid()
    flow = 4e-12 * pressure * 1e5 * (100.0 / (speed * TURN / 60.0)) ** 1.5
    found = diagnose_unit(
        read_unit(
            table(
                tmp_path / "p.csv",
                speed,
                pressure,
                efficiencies(speed, pressure, flow=flow),
            ),
            kind="pump",
        ),
        deals=False,
    ).diagnosis
    assert (found.causes[0].effect, found.causes[0].form) == (
        "slow_leakage",
        "power of speed",
    )
    assert found.causes[0].parameters["exponent"]["value"] == pytest.approx(
        1.5, abs=0.2
    )


# --- from the unit to the transmission ------------------------------------------------------------


@pytest.fixture
def tractor(tmp_path):
    path = tmp_path / "tractor.yaml"
    path.write_bytes(data_path("params/tractor.yaml").read_bytes())
    return path


def test_pair_loses_what_its_units_lost(tmp_path, tractor):
    """Stage H0 has nothing but the pair: its leakage and torque are those of pump and motor."""
    hidden = {
        "pump": {"flow": 1.2e-12 * (PRESSURE * 1e5) * SPEED / 1500.0, "torque": 6.0},
        "motor": {"torque": 5e-7 * PRESSURE * 1e5},
    }
    model, units = load_model(tractor), {}
    for kind, losses in hidden.items():
        path = pump(tmp_path, kind=kind, **losses)
        units[kind] = diagnose_unit(read_unit(path, kind=kind), deals=False)
        assert units[kind].model.effects
        model = put_into(model, units[kind])
    save_model(model, tractor)
    model = load_model(tractor)
    assert {effect.part for effect in model.effects} == {"pump", "motor"}
    assert set(model.units) == {"pump", "motor"}
    stage = model.stages["H0"]
    points = OperatingPoints(
        np.array([0.6, 1.0]), np.array([120.0, 180.0]), np.array([60.0, 150.0])
    )
    solver = BalanceSolver(stage.stage, model.parameters, model.effects)
    _, flow = solver.flow(points)
    state, pair = flow.state, stage.stage.pump_motor
    lost = {}
    for kind, speed in (("pump", state.pump_speed), ("motor", state.motor_speed)):
        found = units[kind].model
        stroke = state.displacement_ratio if kind == "pump" else np.ones(2)
        larger = pair.pump_displacement / found.system.displacement
        points = {
            "displacement_ratio": stroke,
            "speed": speed,
            "pressure": state.pressure,
        }
        # The meters stay at their bench, and a transmission has no less friction than the paper.
        base = found.base * [1.0, 1.0, 0.0, 0.0, 0.0]
        lost[kind] = larger * found.system.predict(base, found.effects, points)
    np.testing.assert_allclose(
        flow.leakage_flow, lost["pump"][0] + lost["motor"][0], rtol=1e-6
    )
    ideal = pair.motor_displacement * state.pressure
    np.testing.assert_allclose(
        ideal - lost["motor"][1], flow.torques["motor"][-1], rtol=1e-6
    )
    ideal = pair.pump_displacement * state.displacement_ratio * flow.pump_pressure
    np.testing.assert_allclose(
        flow.torques["pump"][0], ideal + lost["pump"][1], rtol=1e-6
    )


def test_stroke_and_oil_effects_keep_their_size(tmp_path, tractor):
    _put_an_effect_of_the_users_own(tmp_path, tractor)
    gc.collect()  # its class must not reach other tests


def _put_an_effect_of_the_users_own(tmp_path, tractor):
    @dataclass(frozen=True)
    class Bent(DisplacementGain):
        """By a name that hmcvt does not know."""

        name = "test_bent"
        component = "pump"

    before, of_the_unit = (
        load_model(tractor),
        (Bent(0.02), OilTemperature(0.8), ChargePump(3.0)),
    )
    for kind, other, bent in (
        ("pump", "motor", [("test_bent", 0.02)]),
        ("motor", "pump", []),
    ):
        unit = diagnose_unit(read_unit(pump(tmp_path, kind=kind), kind=kind), deals=0)
        unit = replace(unit, model=replace(unit.model, effects=of_the_unit))
        oil, torque = ("oil_temperature", 0.8), ("charge_pump", 3.0 * 55.0 / CM3)
        for first, then in (
            ((), [*bent, oil, torque]),
            ((OilTemperature(1.0, part=other),), [*bent, torque]),
        ):
            found = put_into(replace(before, effects=first), unit).effects
            assert [
                (effect.name, effect.values()[effect.sizes()[0].name])
                for effect in found
                if effect.part == kind
            ] == [(name, pytest.approx(value)) for name, value in then]


def test_result_is_the_prior_of_a_refit(tmp_path, hmcvt, tractor):
    done = hmcvt("unit", pump(tmp_path), "--kind", "pump", "--into", tractor)
    assert f"pump written into {tractor}" in done.out
    model = load_model(tractor)
    found = diagnose_unit(read_unit(tmp_path / "pump.csv", kind="pump"), deals=False)
    assert model.parameters.pump_damping == pytest.approx(DAMPING * 55.0 / CM3, rel=0.1)
    # The motor leaks as the pump does, until it is known.
    assert model.parameters.leakage == pytest.approx(
        2.0 * LEAKAGE * 55.0 / CM3, rel=0.1
    )
    prior = Prior.of(model)
    assert prior.stated
    wide = np.sqrt(np.diag(prior.covariance))
    assert wide[2] < 0.1 and wide[1] == pytest.approx(1.0)  # of their wear
    assert model.standard_errors["pump_damping"] == pytest.approx(
        found.errors[1] * 55.0 / CM3, rel=1e-6
    )
    # Bench samples then refine it: what they do not say of the pump stays as tested.
    bench, out = tmp_path / "bench.csv", tmp_path / "refined.yaml"
    hm4 = model.stages["HM4"]
    eps, w, load = (
        np.array([0.1, 0.4, -0.3, 0.6, -0.6]),
        np.full(5, 150.0),
        np.full(5, 150.0),
    )
    true = replace(
        hm4, parameters=HydraulicParameters(4e-12, 0.12, hm4.parameters.pump_damping)
    )
    columns = np.column_stack(
        [eps, w, load, true.efficiency(eps, w, load), np.full(5, 0.001)]
    )
    np.savetxt(
        bench,
        columns,
        delimiter=",",
        comments="",
        header="displacement_ratio,engine_speed,load_torque,efficiency,efficiency_std",
    )
    save_model(hm4, tractor)
    data = hmcvt(
        "identify", bench, "--params", tractor, "--refine", "--out", out, "--json"
    ).json
    assert data["error_after"] < 0.5 * data["error_before"]
    refined = load_model(out)
    assert refined.parameters.motor_damping == pytest.approx(0.12, rel=0.15)
    assert refined.parameters.pump_damping == pytest.approx(
        hm4.parameters.pump_damping, abs=2.0 * model.standard_errors["pump_damping"]
    )
    assert list(tmp_path.glob("tractor.previous-*.yaml")), "the old file is kept"


def test_stroke_is_an_axis_where_it_varies():
    samples = next(
        one
        for seed in range(20)
        if np.ptp((one := simulated(("constant_torque",), seed)).displacement_ratio)
    )
    system = HydrostaticUnit(samples)
    names = {effect.name for effect in system.library}
    assert [axis.name for axis in observe_unit(system, samples).axes] == [
        "displacement_ratio",
        "speed",
        "pressure",
    ]
    assert {"displacement_error", "reference_displacement"} <= names
    full = samples.select(samples.displacement_ratio == 1.0)
    assert "displacement_error" not in {
        effect.name for effect in HydrostaticUnit(full).library
    }
    assert UnitModel(system, np.array([-11.0, 0.1, 0.0, 0.0, 0.0]), ()).losses(
        full
    ).shape == (2, len(full))


def test_sizes_of_a_large_unit_load_again(tractor):
    torque = ConstantTorque(torque=90.0)  # of a unit of 200 cm3
    model = replace(load_model(tractor), effects=(replace(torque, part="motor"),))
    save_model(model, tractor)
    assert load_model(tractor).effects == model.effects
    with pytest.raises(InputError, match="torque"):
        effect_from_mapping({**effect_to_mapping(torque), "part": ""}, "effect")


def test_refits_end_at_one_optimum():
    # Leakage takes the place of leakage at low speed: steps are cut short there for long.
    samples = simulated(("compressibility", "slow_leakage"), 2)
    system = HydrostaticUnit(samples)
    kinds = {effect.name: effect for effect in system.library}
    hypothesis = Hypothesis(system, (kinds["compressibility"], kinds["slow_leakage"]))
    observed, rng = observe_unit(system, samples), np.random.default_rng(0)
    middle, spread = system.base.mean, system.base.spread
    noise = [
        refit(
            hypothesis,
            observed,
            np.append(rng.normal(middle, spread), rng.uniform(0.0, 5.0, 2)),
        ).noise
        for _ in range(8)
    ]
    np.testing.assert_allclose(noise, np.broadcast_to(noise[0], (8, 2)), rtol=0.02)
