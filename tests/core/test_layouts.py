# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Every layout, either way, at any load: by hand, by a second solution, by its balance."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects import mechanical
from hmcvt_core.physics.effects.hydraulic import CompressibilityStroke, PressureLeakage
from hmcvt_core.physics.effects.mechanical import ChargePump, ClutchDrag, PlanetaryMesh
from hmcvt_core.transmission.parameters import HydraulicParameters
from hmcvt_core.transmission.ranges import OperatingPoints
from hmcvt_core.transmission.stage import speed_ratio

from .reference import steady_states

FILES = ("tractor", "output_coupled", "hydrostatic")
STAGES = {
    f"{file} {name}": model
    for file in FILES
    for name, model in hmcvt.load_model(
        hmcvt.data_path(f"params/{file}.yaml")
    ).stages.items()
}
# HM4 with its output turned round, and with a pump so large that the output passes standstill.
HM4 = STAGES["tractor HM4"]
STAGES["HM4 back"] = replace(
    HM4,
    stage=replace(
        HM4.stage, reverse=True, output=replace(HM4.stage.output, direction=-1)
    ),
)
STAGES["HM4 through zero"] = replace(
    HM4,
    stage=replace(
        HM4.stage, pump_motor=replace(HM4.stage.pump_motor, pump_displacement=3.5e-5)
    ),
)
every_stage = pytest.mark.parametrize("name", STAGES)


def test_speed_ratios_by_hand():
    # Ring 2, carrier 1, sun n: 2 n_ring = 3 - n_sun; the pump turns n_ring / 0.75, half the size
    # of a motor that turns n_sun / (1 / 0.6667): 0.5 eps (1.5 - 0.5 n) / 0.75 = 0.6667 n.
    def forward(eps):
        return eps / (0.6667 + eps / 3.0)

    def reverse(
        eps,
    ):  # pair R between sun and output, both turned back; a positive stroke too
        return -eps / (0.6667 + 1.2 * eps / 3.0)

    def hm1(eps):  # ring 1 / i1, sun -eps / (i4 i5), carrier = (k ring + sun) / (1 + k)
        return (
            (3.56 / 1.439 - eps / (0.678 * 1.96))
            / 4.56
            / (0.982 * 3.52 * 0.794 * 1.093)
        )

    for name, by_hand in (
        ("output_coupled forward", forward),
        ("output_coupled reverse", reverse),
        ("hydrostatic H", lambda eps: eps / (0.8 * 1.5 * 2.0)),
        ("tractor HM1", hm1),
        (
            "tractor H0",
            lambda eps: eps / (0.678 * 1.96 * 0.982 * 2.767 * 0.794 * 2.767),
        ),
    ):
        for eps in (-0.4, 0.3, 1.0):
            found = speed_ratio(STAGES[name].stage, np.array([eps]))[0]
            assert found == pytest.approx(by_hand(eps), rel=1e-12), name


def test_adjacent_stages_of_the_tractor_meet():
    ratio = {
        name: speed_ratio(STAGES[f"tractor {name}"].stage, np.array([-1.0, 1.0]))
        for name in ("H0", "HM1", "HM2", "HM3", "HM4")
    }
    misses = [
        ratio[low][end] / ratio[high][end] - 1.0
        for low, high, end in (
            ("H0", "HM1", 1),
            ("HM1", "HM2", 0),
            ("HM2", "HM3", 1),
            ("HM3", "HM4", 0),
        )
    ]
    np.testing.assert_allclose(misses, [0.0017, -0.0031, 0.0007, -0.0031], atol=5e-5)


@every_stage
def test_balance_closes_at_any_load(name):
    model, rng = STAGES[name], np.random.default_rng(1)
    stroke, speed, torque = (
        rng.uniform(*ends, 10_000)
        for ends in ((-1.0, 1.0), (78.0, 230.0), (-300.0, 300.0))
    )
    torque[:500] = 0.0
    watts = model.breakdown(stroke, speed, torque)
    efficiency, output, engine = model.solution_at(
        OperatingPoints(stroke, speed, torque)
    )
    lost = model.power_loss(stroke, speed, torque)
    carried = np.isfinite(engine)
    assert carried[torque <= 0.0].all() and carried.mean() > 0.5
    np.testing.assert_array_equal(np.isfinite(watts.input_power), carried)
    scale = sum(np.abs(part) for part in watts.losses.values()) + np.abs(
        watts.input_power
    )
    gap = watts.input_power - watts.output_power - sum(watts.losses.values())
    assert np.nanmax(np.abs(gap) / scale) < 1e-9
    assert min(np.nanmin(part / scale) for part in watts.losses.values()) > -1e-9
    assert (
        np.nanmax(np.abs(lost - watts.input_power + watts.output_power) / scale) < 1e-9
    )
    told = np.isfinite(efficiency) & (torque != 0.0)
    assert ((efficiency[told] > 0.0) & (efficiency[told] < 1.0)).all()
    # In overrun it is engine power / output power, where the wheels turn the engine alone.
    back = (torque < 0.0) & (engine < 0.0)
    np.testing.assert_allclose(
        efficiency[back], engine[back] / torque[back], rtol=1e-12
    )
    assert np.isnan(efficiency[(torque < 0.0) & (engine > 0.0)]).all()
    moving = (
        carried
        & (torque > 0.0)
        & (
            np.abs(speed_ratio(model.stage, stroke))
            > 0.25 * (np.abs(speed_ratio(model.stage, np.array([-1.0, 1.0]))).max())
        )
    )
    assert (output * speed_ratio(model.stage, stroke))[moving].min() > 0.0
    if None in model._point_solvers:
        single = [
            model._point_solvers[None](*point)
            for point in zip(
                stroke[:3000].tolist(), speed.tolist(), torque.tolist(), strict=False
            )
        ]
        np.testing.assert_array_equal(
            np.transpose(single),
            [column[:3000] for column in (efficiency, output, engine)],
        )
        assert pickle.loads(pickle.dumps(model)).fingerprint == model.fingerprint


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
    for stroke, speed, torque in zip(
        rng.uniform(-1, 1, 60),
        rng.uniform(80, 220, 60),
        rng.uniform(-250, 250, 60),
        strict=True,
    ):
        point = (float(stroke), float(speed), float(torque))
        _, output, engine = (
            column[0]
            for column in model.solution_at(OperatingPoints(*np.atleast_2d(point).T))
        )
        if not np.isfinite(engine) or abs(output) < 0.05 * speed:
            continue
        found = steady_states(model.stage, model.parameters, *point, near=[output])
        if not found:  # friction holds the motor
            continue
        checked += 1
        assert output == pytest.approx(found[0].output_speed, rel=1e-7)
        assert engine == pytest.approx(found[0].engine_torque, rel=1e-6, abs=1e-4)
    assert checked > 15


@pytest.mark.parametrize(
    "effect", [ChargePump(5.0), ClutchDrag(6.0), PlanetaryMesh(0.03)]
)
@every_stage
def test_effects_cost_power_in_every_layout(name, effect):
    model = STAGES[name]
    worse, rng = replace(model, effects=(effect,)), np.random.default_rng(3)
    points = [
        rng.uniform(*ends, 500) for ends in ((0.3, 1.0), (80.0, 220.0), (-200.0, 150.0))
    ]
    more = worse.power_loss(*points) - model.power_loss(*points)
    if not model.stage.has_row and effect.name == "planetary_mesh":
        assert np.nanmax(np.abs(more)) < 1e-6
    else:
        assert np.nanmedian(more) > 1.0 and np.isfinite(more).mean() > 0.6


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        (
            "output_coupled",
            "      reverse: true\n",
            "",
            "standing pump = -2.5 .*reverse: true",
        ),
        (
            "output_coupled",
            "layout: output_coupled",
            "layout: both",
            "layout = 'both' is not allowed",
        ),
        (
            "output_coupled",
            "motor: {gear_pairs: [M]}",
            "motor: {gear_pairs: [M], member: sun}",
            r"motor\.member = 'given' is not allowed",
        ),
        (
            "output_coupled",
            ", member: ring",
            "",
            r"stages\.forward\.pump\.member is missing",
        ),
        (
            "hydrostatic",
            "layout: hydrostatic",
            "layout: hydrostatic\n      reverse: true",
            "a hydrostatic stage turns either way",
        ),
        (
            "hydrostatic",
            "pump: {gear_pairs: [P]}",
            "pump: {gear_pairs: [P]}\n      mechanical: {}",
            "a hydrostatic stage has no mechanical path",
        ),
        (
            "tractor",
            "    HM2:\n",
            "    HM2:\n      clutch: c2\n",
            r"HM2\.clutch at line \d+ is not known",
        ),
        (
            "tractor",
            "[0.4147, 0.6534]",
            "0.4",
            r"HM4\.open_clutches = .*allowed: name: \[slip per",
        ),
    ],
)
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
    assert (
        list(again.stages) == list(model.stages)
        and again.fingerprint == model.fingerprint
    )
    for name, stage in model.stages.items():
        point = (0.6, 170.0, 40.0)
        assert again.stages[name].efficiency(*point) == stage.efficiency(*point)
        assert model.efficiency(*point, stage=name) == stage.efficiency(*point)
    names = np.array(list(model.stages))[[0, -1, 0]]
    np.testing.assert_array_equal(
        model.efficiency(0.6, 170.0, 40.0, stage=names),
        [model.stages[name].efficiency([0.6], 170.0, 40.0)[0] for name in names],
    )
    with pytest.raises(
        hmcvt.InputError, match="stage 'HM9' is not known to the model; there is"
    ):
        model.efficiency(0.6, 170.0, 40.0, stage="HM9")


@pytest.mark.parametrize(
    ("name", "parameters", "effects", "point"),
    [
        ("hydrostatic H", None, (), (0.0, 150.0, 0.0)),  # in neutral
        (
            "hydrostatic H",
            None,
            (ChargePump(4.0), mechanical.PlanetaryRolling(0.03)),
            (0.0, 150.0, 0.0),
        ),
        ("tractor H0", None, (ChargePump(4.0),), (0.0, 80.0, 0.0)),
        # A long step would turn the output back, where nothing drives the load.
        (
            "hydrostatic H",
            None,
            (PressureLeakage(3.75e-11, 2.0),),
            (0.0529, 94.7, -144.06),
        ),
        (
            "hydrostatic H",
            None,
            (CompressibilityStroke(3.75, 0.5, 0.0, 5.0),),
            (0.0842, 69.34, -163.9),
        ),
        # Its motor balances in the regime that is less likely.
        (
            "tractor HM2",
            HydraulicParameters(1e-14, 0.0, 0.0),
            (PressureLeakage(3.75e-11, 2.0),),
            (0.197600971, 80.04830837, 689.75722296),
        ),
    ],
)
def test_states_next_to_rest(name, parameters, effects, point):
    """Each was refused by mistake once."""
    model = replace(STAGES[name], effects=effects, standard_errors={}, correlation=None)
    model = replace(model, parameters=parameters or model.parameters)
    loss = model.power_loss(*point)
    assert loss > 0.0
    assert sum(model.breakdown(*point).losses.values()) == pytest.approx(loss, rel=1e-6)
    with_another = np.transpose([point, (0.5, 80.0, 300.0)])
    assert model.power_loss(*with_another)[0] == loss
