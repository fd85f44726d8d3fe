# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Published formulas: against a plain transcription of the paper, and the guard around them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

import hmcvt_core as hmcvt
from hmcvt_core.physics import published
from hmcvt_core.physics.effects import Effect
from hmcvt_core.transmission.parameters import PAPER_PARAMETERS
from hmcvt_core.transmission.ranges import OperatingPoints

from .strategies import engine_speeds, load_torques, parameters, stages

# About what Table 2 gives with objective (21); the other two are the paper's.
IDENTIFIED = hmcvt.HydraulicParameters(6.4e-11, 0.0, 0.36)
PARAMETER_SETS = [IDENTIFIED, PAPER_PARAMETERS[0.98], PAPER_PARAMETERS[0.97]]
SPEEDS = [78.54, 150.0, 230.0]
GRID = np.linspace(-1.0, 1.0, 4001)


def transcription(parameters, eps, engine_speed, load_torque, gear):
    """Eqs (5)-(18) line by line in scalars, readings 1, 2, 4 (docs/theory.md)."""
    i2, i3, i4, i5, i6, i11, k1 = 0.969, 1.484, 0.678, 1.96, 0.982, 0.823, 2.56
    v = 55e-6 / (2.0 * math.pi)
    i_hm = 1.0 / (
        ((1 + k1) * i4 * i5 + eps * i2 * i3) / (k1 * i2 * i3 * i4 * i5 * i6 * i11)
    )
    a = -1.0 / (1.0 + k1)
    e_h = 1.0 - i_hm / (1.0 + a)
    if eps == 0.0:
        eta_h = 5e-5
    else:
        sign = math.copysign(1.0, eps)
        t_out = load_torque * i_hm
        w_p = engine_speed / i4
        pressure = (
            t_out / (i5 * i6 * i11 * k1) + parameters.motor_damping * eps * w_p
        ) / v
        w_m = (v * w_p * eps - parameters.leakage * pressure) / v
        t_m = pressure * v - parameters.motor_damping * w_m - 0.01 * pressure * v
        t_p = (
            pressure * v * eps
            + sign * parameters.pump_damping * w_p
            - 0.01 * pressure * v * eps
        )
        eta_h = abs(w_m * t_m / (w_p * t_p))
    tandem = eta_h * gear * gear
    r = (1.0 + a) / i_hm
    circulating, split = (
        r / (tandem * r - tandem + 1.0),
        tandem * r / (r + tandem - 1.0),
    )
    eta_hm = circulating if e_h < 0.0 else split
    # As printed, (11) multiplies by eta_4 eta_H eta_5 after dividing by eta_3 eta_2.
    a_1 = e_h / ((1.0 / eta_hm - e_h) / gear**2 * tandem + e_h)
    eta_m1 = (1.0 - a_1) * gear**2 + a_1
    return eta_h, eta_m1 * eta_hm * gear**2


@pytest.mark.parametrize("gear", [0.98, 0.97])
@pytest.mark.parametrize("found", PARAMETER_SETS)
def test_bench_tests_equal_the_transcription(hm4, table2, found, gear):
    model = hmcvt.EfficiencyModel(hm4.with_gear_efficiency(gear), found, "published")
    answered = 0
    for point in zip(
        table2.displacement_ratio, table2.engine_speed, table2.load_torque, strict=True
    ):
        _, expected = transcription(found, *point, gear)
        efficiency = model.efficiency(*point)
        if np.isfinite(efficiency):
            answered += 1
            assert efficiency == pytest.approx(expected, rel=1e-12)
    assert answered >= 6


@pytest.mark.parametrize("found", PARAMETER_SETS)
@pytest.mark.parametrize("engine_speed", SPEEDS)
def test_poles_are_masked(hm4, found, engine_speed):
    points = OperatingPoints(
        GRID, np.full(GRID.shape, engine_speed), np.full(GRID.shape, 200.0)
    )
    hydraulic = published.hydraulic_efficiency(hm4, found, points)
    found_at = published.efficiencies(hm4, GRID, hydraulic)
    bare = found_at.total
    # docs/theory.md: unguarded, every one of these nine cases has a pole.
    assert np.nanmax(np.abs(bare)) > 1.0
    model = hmcvt.EfficiencyModel(hm4, found, "published")
    served = model.efficiency(GRID, engine_speed, 200.0)
    answered = np.isfinite(served)
    assert ((served[answered] > 0.0) & (served[answered] < 1.0)).all()
    np.testing.assert_array_equal(served[answered], bare[answered])
    assert np.isnan(served[~answered]).all()
    assert 0.3 < answered.mean() < 1.0  # the mask reaches from eps = 0 to the pole
    # Between the two a share a_1 > 1 of the engine power contradicts power that circulates
    # (e_H < 0), also where eta_total happens to fall into (0, 1).
    beyond = (
        (found_at.engine_share > 1.0) & (found_at.split_ratio < 0.0) & (GRID != 0.0)
    )
    assert ((bare[beyond] > 0.0) & (bare[beyond] < 1.0)).any()
    assert np.isnan(served[beyond]).all()


@given(stages(), parameters, engine_speeds, load_torques)
def test_guard_holds_for_any_stage(stage, found, engine_speed, load_torque):
    model = hmcvt.EfficiencyModel(stage, found, "published")
    some = GRID[::50]
    served = model.efficiency(some, engine_speed, load_torque)
    answered = np.isfinite(served)
    assert ((served[answered] > 0.0) & (served[answered] < 1.0)).all()
    # Eq. (12) ends at e_H = 1: beyond, the output runs backward.
    assert (model.output_speed(some, engine_speed, load_torque)[answered] > 0.0).all()


def test_leakage_that_turns_the_motor_is_refused(hm4):
    leaky = hmcvt.HydraulicParameters(1e-9, 0.0, 0.1)
    point = OperatingPoints(np.array([0.3]), np.array([78.54]), np.array([300.0]))
    assert np.isnan(published.hydraulic_efficiency(hm4, leaky, point)[0])


def test_no_watts_and_no_effects_without_a_balance(hm4):
    model = hmcvt.EfficiencyModel(hm4, IDENTIFIED, "published")
    with pytest.raises(
        hmcvt.InputError, match="breakdown of watts needs formulation power_bal"
    ):
        model.breakdown(0.5, 100.0, 100.0)
    with pytest.raises(hmcvt.InputError, match="effects act in the power balance only"):
        replace(model, effects=(Effect(),))
