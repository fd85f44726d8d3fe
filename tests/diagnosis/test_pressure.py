# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The pressure over the motor as a channel: what the balance reads, and what it settles."""

from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import CHANNELS, Transmission, observe
from hmcvt_core.diagnosis.fitting.hypothesis import Hypothesis
from hmcvt_core.diagnosis.fitting.refit import linearise, refit
from hmcvt_core.model.plausibility import pressure_remark
from hmcvt_core.physics.effects.hydraulic import PressureFrictionFull
from hmcvt_core.physics.effects.sensor import PressureGain, PressureZero

from .campaigns import BASE, NOISE, STAGE, campaign, random_points, with_column

GAUGE = 5e4  # Pa


def test_the_pressure_is_that_of_the_flow_and_of_the_load():
    points = random_points(3, 200)
    read = BASE.readings_at(points)
    efficiency, speed = read["efficiency"], read["output_speed"]
    units, leakage = STAGE.pump_motor, BASE.parameters.leakage
    np.testing.assert_allclose(
        [efficiency, speed], BASE.solution_at(points)[:2], rtol=1e-9
    )
    # Eq. (13): what the motor does not take leaks.
    motor = (speed - STAGE.mechanical_speed_ratio * points.engine_speed) / abs(
        STAGE.motor_speed_ratio
    )
    pumped = points.displacement_ratio * points.engine_speed / STAGE.pump.ratio
    np.testing.assert_allclose(
        read["pressure"],
        (pumped - motor) * units.motor_displacement / leakage,
        rtol=1e-6,
    )
    # Eq. (14) where the motor drives, with the pairs between it and the output.
    driving = motor > 1.0
    torque = (
        points.load_torque
        * points.engine_speed
        / speed
        * abs(STAGE.motor_speed_ratio)
        / (STAGE.output.efficiency * STAGE.motor.efficiency)
    )
    friction = read["pressure"] * units.motor_displacement * units.motor_friction
    np.testing.assert_allclose(
        (read["pressure"] * units.motor_displacement - friction)[driving],
        (torque + BASE.parameters.motor_damping * motor)[driving],
        rtol=1e-9,
    )


@pytest.mark.parametrize(
    "read",
    [
        ("efficiency",),
        ("efficiency", "pressure"),
        ("efficiency", "output_speed", "pressure"),
    ],
)
def test_any_of_the_channels_may_be_read(read):
    samples = campaign(n=40, seed=2, noise=1e-6, speed_noise=1e-6, pressure_noise=1.0)
    observed = observe(
        with_column(
            samples,
            **{name: None for name in ("output_speed", "pressure") if name not in read},
        ),
        NOISE,
    )
    system = Transmission(BASE)
    truth = np.array([np.log10(2e-11), 0.12, 0.2, *np.zeros(len(system.base) - 3)])
    predicted = system.predict(truth, (), observed.points)
    assert predicted.shape == (len(CHANNELS), 40)
    assert [item.name for item in observed.channels] == list(read)
    whitened = linearise(
        Hypothesis(system), observed, truth, np.ones(len(read))
    ).whitened
    assert whitened.shape == (len(read), 40)
    assert np.abs(whitened).max() < 0.01


@pytest.mark.long
def test_pressure_tells_friction_of_the_motor_where_speed_is_not_read():
    samples = campaign(
        (PressureFrictionFull(0.04),), 1, speed_noise=None, pressure_noise=GAUGE
    )
    found = hmcvt.diagnose(BASE, samples, noise=NOISE)
    assert found.causes[0].effect == "pressure_friction"
    assert found.causes[0].probability > 0.95
    assert found.causes[0].parameters["coefficient"]["value"] == pytest.approx(
        0.04, rel=0.15
    )


def test_the_refit_bears_a_gauge_within_its_class():
    samples = campaign(
        (PressureGain(0.01), PressureZero(-1e5)), seed=4, pressure_noise=GAUGE
    )
    fit = refit(Hypothesis(Transmission(BASE, ["pressure"])), observe(samples, NOISE))
    assert np.sqrt(np.mean(fit.whitened[2] ** 2)) < 1.0
    np.testing.assert_allclose(fit.base[-2:], [1.0, -1.0], atol=0.5)


def test_a_gauge_that_is_off_is_named():
    # The boost pressure was not taken off.
    wrong = campaign((PressureZero(2e6),), seed=4, pressure_noise=GAUGE)
    found = hmcvt.diagnose(BASE, wrong, noise=NOISE)
    assert found.causes[0].effect == "pressure_sensor"
    assert found.causes[0].parameters["zero"]["value"] == pytest.approx(2e6, rel=0.1)


def test_a_motor_of_another_size_is_told():
    samples = campaign(n=24, seed=1, pressure_noise=GAUGE)
    assert pressure_remark(BASE, samples) is None
    assert pressure_remark(BASE, replace(samples, pressure=None)) is None
    for factor, words in ((1.3, "1.3"), (1e-5, "1e-05")):  # bar
        wrong = replace(samples, pressure=factor * samples.pressure)
        assert pressure_remark(BASE, wrong).startswith(
            f"the pressure is {words} times that of a motor of 55 cm3/r under this load: check"
        )
