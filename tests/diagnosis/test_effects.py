# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What holds for every effect in the library, and for one that a user adds."""

import gc
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

import hmcvt_core as hmcvt
from hmcvt_core.diagnosis.system import forms_of
from hmcvt_core.physics.balance import BalanceSolver
from hmcvt_core.physics.effects import effect_from_mapping, effect_to_mapping, library
from hmcvt_core.physics.effects.base import Effect, size
from hmcvt_core.physics.effects.hydraulic import OilTemperature, walther_log_viscosity
from hmcvt_core.physics.effects.mechanical import ChargePump, Churning
from hmcvt_core.transmission.ranges import OperatingPoints

from .campaigns import BASE, NOISE, campaign, random_points

PAGE = Path(__file__).parents[2].joinpath("docs/effects.md").read_text(encoding="utf-8")

# Design, section 7.
NAMES = {
    "charge_pump",
    "churning",
    "clutch_drag",
    "gear_mesh",
    "planetary_mesh",
    "pressure_leakage",
    "pressure_friction",
    "compressibility",
    "displacement_error",
    "oil_temperature",
    "torque_sensor",
}
COMPONENTS = {
    "pump",
    "motor",
    "gears",
    "clutches",
    "planetary",
    "actuator",
    "oil",
    "sensor",
}
KINDS = library()
POINTS = random_points(11, 60, temperature=True)
STANDING = OperatingPoints(
    np.array([0.0, 0.0, 0.003, -0.003]),
    np.full(4, 120.0),
    np.array([80.0, 300.0, 150.0, 150.0]),
    np.full(4, 70.0),
)


# By effect, the shape above which it acts; tests need not reach it.
THRESHOLDS = {
    "relief_valve": "cracking",
    "inlet_starvation": "full_speed",
    "clutch_slip": "holding",
    "fan_drive": "start",
}


def _label(kind):
    return f"{kind.name} {kind.form}".strip()


def _at(kind, part=1.0):
    """Every form of a kind at a part of its typical size."""
    return [
        form.with_values({item.name: part * item.typical for item in form.sizes()})
        for form in forms_of(kind())
    ]


def _acting(kind, part=1.0):
    """The forms that act within the tests: of a threshold, those at the lowest."""
    threshold = THRESHOLDS.get(kind.name)
    lowest = {item.name: min(item.grid) for item in kind.parameters() if item.grid}
    return [
        form
        for form in _at(kind, part)
        if threshold is None or form.values()[threshold] == lowest[threshold]
    ]


every_kind = pytest.mark.parametrize("kind", KINDS, ids=_label)
losses = pytest.mark.parametrize(
    "kind",
    [
        kind
        for kind in KINDS
        if kind.sizes()[0].low >= 0.0
        and kind.component not in ("sensor", "actuator")
        and kind.name != "oil_temperature"
    ],
    ids=_label,
)  # hot oil damps less


def test_the_names_of_the_contract_are_there():
    names = {kind.name for kind in KINDS}
    assert names >= NAMES
    assert names >= {
        "bearing_drag",
        "orifice_leakage",
        "stroke_leakage",
        "output_churning",
        "port_pressure_drop",
        "pressure_sensor",
        "relief_valve",
        "inlet_starvation",
        "fan_drive",
        "accessory_drive",
        "clutch_slip",
        "brake_drag",
    }, "named as further ones"
    assert len({(kind.name, kind.form) for kind in KINDS}) == len(KINDS)


@every_kind
def test_metadata(kind):
    assert kind.component in COMPONENTS
    for text in (kind.summary, kind.source, kind.remedy, kind.__doc__):
        assert text and len(text) > 10, f"{kind.__name__} says too little of itself"
    assert len(kind.sizes()) == 1, "one size an effect: what the search expects"
    for item in kind.parameters():
        assert item.unit and item.meaning
        assert item.low <= item.typical <= item.high
        if item.is_size:
            assert item.low <= 0.0 <= item.high
            assert 0.0 < item.typical < item.high
            assert getattr(kind(), item.name) == 0.0
        else:
            assert getattr(kind(), item.name) in item.grid
            assert list(item.grid) == sorted(set(item.grid))


def _on_the_page(item):
    unit = "" if item.unit == "-" else f" [{item.unit}]"
    if item.is_size:
        return f"`{item.name}`{unit} {item.typical:g} ({item.low:g} to {item.high:g})"
    tried = f"`{item.name}`{unit} tried at {', '.join(f'{x:g}' for x in item.grid)}"
    if item.low == item.grid[0] and item.high == item.grid[-1]:
        return tried
    return f"{tried}, refitted from {item.low:g} to {item.high:g}"


@every_kind
def test_the_page_of_effects_states_the_law_its_parameters_and_its_source(kind):
    (section,) = re.findall(rf"^### {kind.name}\n(.*?)^##", PAGE, re.M | re.S)
    (row,) = re.findall(rf"^\| {kind.form or '-'} \|.*", section, re.M)
    law = kind.__doc__.split("\n")[0].replace("|", "\\|")
    assert f" {kind.component} | {law} " in row
    for item in kind.parameters():
        assert _on_the_page(item) in row
    assert kind.source.rstrip(".") in section
    assert kind.remedy in section


@every_kind
def test_size_zero_changes_nothing(kind):
    for effect in forms_of(kind()):
        for points in (POINTS, STANDING):
            model = replace(BASE, effects=(effect,))
            np.testing.assert_allclose(
                model.solution_at(points), BASE.solution_at(points), rtol=1e-9
            )


@every_kind
def test_typical_size_shows_in_what_the_bench_reads(kind):
    for effect in _acting(kind):
        readings, base = (
            model.readings_at(POINTS)
            for model in (replace(BASE, effects=(effect,)), BASE)
        )
        visible = {"efficiency": 1e-3, "output_speed": 0.1, "pressure": 2e5}
        shown = [
            np.abs(readings[name] - base[name]) / size for name, size in visible.items()
        ]
        assert np.nanmax(shown) > 1.0


@every_kind
@pytest.mark.parametrize("part", [0.3, 1.0, 3.0])
def test_watts_close_with_the_effect_on(kind, part):
    for effect in _at(kind, part):
        model = replace(BASE, effects=(effect,))
        for points in (POINTS, STANDING):
            watts = model.breakdown(*points)
            lost = sum(watts.losses.values())
            solved = np.isfinite(watts.input_power)
            assert solved.mean() > 0.5
            np.testing.assert_allclose(
                (watts.input_power - watts.output_power)[solved],
                lost[solved],
                rtol=1e-9,
                atol=1e-6,
            )


@losses
@pytest.mark.parametrize("extreme", [False, True], ids=["typical", "bound"])
def test_losses_take_power(kind, extreme):
    bare = BASE.breakdown(*POINTS).input_power
    for form in _acting(kind):
        (item,) = form.sizes()
        effect = form.with_values({item.name: item.high if extreme else item.typical})
        model = replace(BASE, effects=(effect,))
        efficiency = model.solution_at(POINTS).efficiency
        known = efficiency[np.isfinite(efficiency)]
        assert known.size > 0
        assert ((known > 0.0) & (known < 1.0)).all()
        # Over the working range: a motor held by friction slips less, here and there a gain.
        assert extreme or np.nanmean(model.breakdown(*POINTS).input_power - bare) > 0.0


def test_walther_gives_the_grade_of_the_oil():
    np.testing.assert_allclose(
        np.exp(walther_log_viscosity(np.array([40.0, 100.0]))), [46.0, 6.8], rtol=1e-9
    )
    assert (np.diff(walther_log_viscosity(np.linspace(-40.0, 150.0, 50))) < 0.0).all()


@pytest.mark.parametrize(
    "grade", [(32.0, 5.4), (46.0, 10.0), (55.0, 9.2), (68.0, 11.0), (220.0, 19.0)]
)
def test_two_numbers_meet_the_viscosity_of_any_oil(grade):
    warm = np.linspace(30.0, 90.0, 31)
    known = OilTemperature(1.0, viscosity_40=grade[0], viscosity_100=grade[1])
    measured = np.log(known.viscosity_ratio(warm))
    at = np.exp(walther_log_viscosity(np.array([40.0, 100.0]), *grade))
    np.testing.assert_allclose(at, grade, rtol=1e-9)

    def missed(numbers):
        strength, viscosity_100 = numbers
        oil = OilTemperature(strength, viscosity_100=viscosity_100)
        return np.log(oil.viscosity_ratio(warm)) - measured

    found = least_squares(missed, [1.0, 6.8], bounds=([0.0, 4.0], [2.5, 20.0]))
    assert np.abs(found.fun).max() < 0.002


def test_a_file_with_the_strength_alone_means_an_oil_of_grade_46():
    words = {
        "effect": "oil_temperature",
        "parameters": {"strength": {"value": 1.2, "unit": "-"}},
    }
    oil = effect_from_mapping(words)
    assert oil == OilTemperature(1.2, viscosity_40=46.0, viscosity_100=6.8)


def test_films_follow_the_oil_with_a_power_of_their_own():
    warm = POINTS._replace(oil_temperature=np.full_like(POINTS.engine_speed, 90.0))
    ratio = OilTemperature(1.0).viscosity_ratio(warm.oil_temperature)[0]
    thin = replace(
        BASE.parameters,
        leakage=BASE.parameters.leakage / ratio,
        **{
            name: getattr(BASE.parameters, name) * ratio**0.67
            for name in ("motor_damping", "pump_damping")
        },
    )
    np.testing.assert_allclose(
        replace(BASE, effects=(OilTemperature(1.0, film_exponent=0.67),)).readings_at(
            warm
        )["efficiency"],
        replace(BASE, parameters=thin).readings_at(POINTS)["efficiency"],
        rtol=1e-9,
    )


def test_effects_add_up_in_one_model():
    both, alone = (
        BalanceSolver(BASE.stage, BASE.parameters, effects).flow(POINTS)[1]
        for effects in ((ChargePump(5.0), Churning(5.0)), (ChargePump(5.0),))
    )
    churned = (
        5.0 * (POINTS.engine_speed / 150.0) ** Churning().exponent * POINTS.engine_speed
    )
    np.testing.assert_allclose(
        both.engine_power - alone.engine_power, churned, rtol=1e-9
    )


def _diagnose_an_effect_of_the_users_own():
    """Everything about a new class in one frame, so that nothing of it outlives the call."""

    @dataclass(frozen=True)
    class Resonance(Effect):
        """Torque that peaks at one engine speed."""

        name = "test_resonance"
        component = "gears"
        summary = "a shaft resonance takes torque near 150 rad/s"
        source = "written in a test"

        torque: float = size(
            "N m", 8.0, 0.0, 60.0, "drag torque on the engine at resonance"
        )

        def engine_drag(self, state):
            return self.torque * np.exp(-(((state.engine_speed - 150.0) / 15.0) ** 2))

    samples = campaign((Resonance(12.0),), seed=3, n=48)
    found = hmcvt.diagnose(BASE, samples, noise=NOISE)
    again = effect_from_mapping(effect_to_mapping(Resonance(2.0)))
    return found.to_dict(), again.values(), Resonance in library()


def test_a_new_effect_is_one_small_class():
    found, values, listed = _diagnose_an_effect_of_the_users_own()
    gc.collect()
    assert listed
    assert values == {"torque": 2.0}
    assert found["verdict"] == "cause_found"
    assert found["component"] == "gears"
    leading = found["causes"][0]
    assert leading["effect"] == "test_resonance"
    assert leading["parameters"]["torque"]["value"] == pytest.approx(12.0, rel=0.25)
    assert library() == KINDS, "the class of this test must not reach others"
