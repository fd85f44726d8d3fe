# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Effects in parameter files: values in range, units, and which class a name means."""

import gc
from dataclasses import dataclass, replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects import effect_from_mapping, effect_to_mapping, library
from hmcvt_core.physics.effects.hydraulic import PortPressureDrop
from hmcvt_core.physics.effects.mechanical import ChargePump
from hmcvt_core.physics.effects.sensor import EngineTorqueGain, OutputTorqueZero


def torque(value, unit="N m"):
    return {
        "effect": "charge_pump",
        "parameters": {"torque": {"value": value, "unit": unit}},
    }


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (
            torque(-50.0),
            r"^effects\[0\].parameters.torque.value = -50 is outside 0 to \d+ N m$",
        ),
        (
            torque(5.0, "kN m"),
            r"^effects\[0\].parameters.torque.unit = 'kN m'; needs 'N m'$",
        ),
        (
            torque("much"),
            r"^effects\[0\].parameters.torque.value = 'much' is not a finite number",
        ),
        (torque(float("nan")), r"torque.value = nan is not a finite number"),
        (torque(True), r"torque.value = True is not a finite number"),
        (
            {"effect": "gremlins", "parameters": {}},
            r"effect = 'gremlins', form = '' is not known",
        ),
        (
            {"effect": "charge_pump", "form": "square"},
            r"form = 'square' is not known; .* charge_pump",
        ),
        (
            {"effect": "charge_pump", "parameters": {"torq": 3.0}},
            r"parameters.torq is not known; ",
        ),
        (
            {"effect": "charge_pump", "parameters": [3.0]},
            r"parameters = \[3.0\] is not a mapping",
        ),
        (None, r"^effects\[0\] = None is not a mapping"),
        (
            {
                "effect": "torque_sensor",
                "form": "gain of the engine meter",
                "parameters": {"gain": -1.0},
            },
            r"^effects\[0\].parameters.gain = -1 is outside -0.1 to 0.1$",
        ),
    ],
)
def test_what_is_wrong_is_named(data, message):
    with pytest.raises(hmcvt.InputError, match=message):
        effect_from_mapping(data, "effects[0]")


@pytest.mark.parametrize(
    "kind", library(), ids=lambda kind: f"{kind.name} {kind.form}".strip()
)
def test_every_effect_is_read_at_its_limits(kind):
    for end in ("low", "high"):
        effect = kind(**{item.name: getattr(item, end) for item in kind.parameters()})
        assert effect_from_mapping(effect_to_mapping(effect)) == effect


def test_two_classes_of_one_name_are_refused_and_a_nameless_subclass_is_none():
    assert type(_read_beside(vars={})) is ChargePump
    with pytest.raises(hmcvt.InputError, match=r"ChargePump and .*Again have the same"):
        _read_beside(vars={"name": "charge_pump"})
    gc.collect()  # a class stays in the library as long as it lives
    assert effect_from_mapping(torque(5.0)) == ChargePump(5.0)


def _read_beside(vars):
    """Read an effect while a program has a subclass of it."""
    again = dataclass(frozen=True)(type("Again", (ChargePump,), vars))
    assert vars or again not in library()
    return effect_from_mapping(torque(5.0))


METER_HOOKS = ("reading", "output_speed_reading", "true_load_power", "pressure_reading")


@pytest.mark.parametrize(
    "kind", library(), ids=lambda kind: f"{kind.name} {kind.form}".strip()
)
def test_effects_on_meters_are_those_of_component_sensor(kind):
    assert kind.acts_at(*METER_HOOKS) == (kind.component == "sensor")


METERS = (EngineTorqueGain(-0.1), OutputTorqueZero(10.0))


@pytest.mark.parametrize("meter", METERS, ids=lambda meter: meter.form)
def test_optimum_map_and_breakdown_are_of_the_transmission(model, meter):
    physical = replace(model, effects=(ChargePump(5.0),))
    read = replace(model, effects=(ChargePump(5.0), meter))
    point = (0.5, 150.0, 200.0)
    assert abs(read.efficiency(*point) - physical.efficiency(*point)) > 0.01
    assert read.without_meters().effects == physical.effects
    assert read.optimal_displacement_ratio(
        *point[1:]
    ) == physical.optimal_displacement_ratio(*point[1:])
    assert (
        read.efficiency_map(*point).efficiency
        == physical.efficiency_map(*point).efficiency
    )
    assert read.breakdown(*point) == physical.breakdown(*point)


def test_leakage_is_a_loss_also_behind_a_line_that_takes_pressure(model):
    drop = replace(model, effects=(PortPressureDrop(5e6, 1.0),))
    watts = drop.breakdown(
        [[-1.0], [-0.6], [0.3], [0.6], [1.0]], 200.0, [20.0, 100.0, 300.0]
    )
    assert (watts.losses["leakage"] >= 0.0).all()
    np.testing.assert_allclose(
        sum(watts.losses.values()), watts.input_power - watts.output_power
    )


@pytest.mark.parametrize("file", ["tractor", "output_coupled", "hydrostatic"])
def test_lines_carry_what_the_motor_leaks(file):
    model = hmcvt.load_model(hmcvt.data_path(f"params/{file}.yaml"))
    for leakage, alike in ((1e-14, True), (model.parameters.leakage, False)):
        tight = replace(model, parameters=replace(model.parameters, leakage=leakage))
        for stage in model.stages:
            one, other = (
                replace(tight, effects=(PortPressureDrop(2e6, 1.0, part),))
                .in_stage(stage)
                .efficiency([-0.8, -0.3, 0.4, 0.9], 150.0, 100.0)
                for part in (0.0, 1.0)
            )
            assert np.allclose(one, other, rtol=1e-4, equal_nan=True) == alike


def test_an_effect_may_fill_an_array_where_another_is_large(table2):
    def filled(self, state):
        found = np.zeros_like(state.engine_speed)
        found[state.pressure > 7e6] = self.torque
        return found

    own = dataclass(frozen=True)(type("Own", (ChargePump,), {"pump_drag": filled}))(
        20.0
    )
    shipped = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    model, point = (
        replace(shipped, effects=(own,)),
        (np.linspace(-1.0, 1.0, 9), 150.0, 300.0),
    )
    assert 0 < np.sum(model.efficiency(*point) < shipped.efficiency(*point)) < 9
    assert model.optimal_displacement_ratio(*point[1:]).efficiency > 0.5
    assert hmcvt.identify(table2, effects=(own,)).model.effects == (own,)


OWN_EFFECT = """
from dataclasses import dataclass
from hmcvt_core import Effect, size

@dataclass(frozen=True)
class Own(Effect):
    name = "own_misspelt"
    summary = "an effect for a test"
    remedy = "none"
    torque: float = size("N m", 5.0, 0.0, 50.0, "torque")

    def {hook}(self, state):
        return self.torque
"""


@pytest.mark.parametrize(
    ("hook", "message"),
    [
        ("outputdrag", "method outputdrag is no hook; output_drag is"),
        ("output_drags", "method output_drags is no hook; output_drag is"),
        ("loss_of_all", "own_misspelt: overrides no hook; there is "),
    ],
)
def test_a_misspelt_hook_is_refused_by_name(tmp_path, hook, message):
    path = tmp_path / f"own_{hook}.py"
    path.write_text(OWN_EFFECT.format(hook=hook), encoding="utf-8")
    with pytest.raises(hmcvt.InputError, match=message):
        hmcvt.load_effects(str(path))
    assert "own_misspelt" not in {kind.name for kind in library()}
