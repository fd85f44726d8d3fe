# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The family of forms of an effect spans what the literature writes for it.

Each published form is put into the balance. What counts is what it leaves after the refit of the
base, and of this the part that no form of its family makes.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from hmcvt_core.benches.transmission import Transmission, observe
from hmcvt_core.diagnosis.fitting.hypothesis import Hypothesis
from hmcvt_core.diagnosis.fitting.refit import linearise
from hmcvt_core.diagnosis.system import forms_of
from hmcvt_core.physics.balance import BalanceSolver
from hmcvt_core.physics.effects.base import Effect
from hmcvt_core.transmission.parameters import to_scaled

from .campaigns import BASE, measure, random_points

PAGE = (Path(__file__).parents[2] / "docs/diagnosis-method.md").read_text()


def _as_effect(**hooks):
    return type(
        "Published",
        (Effect,),
        {
            name: lambda self, *given, f=function: f(*given)
            for name, function in hooks.items()
        },
    )()


def _clutch(peak, fall, feed, against=0.0):
    """Shear of a full film, then a wetted radius that shrinks [Yuan et al. 2007]; late rise."""

    def torque(state):
        slip = state.output_speed - against * state.engine_speed
        flow = (
            state.engine_speed / 150.0
        ) ** feed  # of a pump on the engine, or held (0)
        x = np.abs(slip) / (peak * flow)
        film = flow * x / (1.0 + x**4) ** (fall / 4.0)
        return (
            6.0 * np.sign(slip) * (film + 0.02 * (slip / 300.0) ** 2)
        )  # [Pan & Zhou 2019]

    return _as_effect(
        output_drag=torque, engine_drag=lambda state: -against * torque(state)
    )


def _mesh(part):
    """Further part lost in a pair, of torque / 250 N m and speed / 150 rad/s."""

    def loss(power, speed):
        turning = np.maximum(np.abs(speed), 1.0)
        return 0.002 * np.clip(
            part(np.abs(power) / turning / 250.0 + 0.004, turning / 150.0), 0.0, 10.0
        )

    return _as_effect(gear_loss=loss)


def _benedict_kelley(decades, power):
    """log10 of load / speed^power, above a floor where the film is full."""
    return _mesh(
        lambda t, w: (
            np.logaddexp(0.0, 4.0 * (decades + np.log10(t) - power * np.log10(w))) / 4.0
        )
    )


def _leak(part):
    """Leakage of part(dp / 20 MPa, stroke), at most one."""
    return _as_effect(
        leakage_flow=lambda state: (
            3e-12
            * state.pressure
            * part(np.abs(state.pressure) / 20e6, np.abs(state.displacement_ratio))
        )
    )


def _eccentric(pump, motor, lifted):
    """1.5 e^2, e = the side force / that which lifts the piston to the wall, at most 1."""
    return _leak(
        lambda p, x: (
            1.5
            * (
                pump * np.minimum(1.0, p * x / lifted) ** 2
                + motor * np.minimum(1.0, p / lifted) ** 2
            )
        )
    )


def _row_mesh(part):
    """Fraction of the rolling power lost, of sun torque / 250 N m and rolling speed / 150 rad/s."""
    return _as_effect(
        planetary_loss=lambda state: (
            0.02
            * np.clip(
                part(
                    np.abs(state.sun_torque) / 250.0 + 0.004,
                    np.abs(state.sun_speed) / 150.0 + 0.007,
                ),
                0.0,
                10.0,
            )
        )
    )


def _air(share, exponent, stiffening):
    """Both units squeeze oil with a share of air at 1 atm, above 2 MPa of charge pressure."""

    def flow(state):
        p, x = np.abs(state.pressure), state.displacement_ratio
        left = (1.013e5 / (2e6 + np.array([0.0 * p, p]))) ** (1.0 / exponent)
        squeezed = (
            np.log1p(stiffening * p / 1.5e9) / stiffening if stiffening else p / 1.5e9
        )
        squeezed = np.sign(state.pressure) * (squeezed + share * (left[0] - left[1]))
        motor = (1.0 - 0.5 * np.sign(state.motor_speed)) * np.abs(state.motor_speed)
        volume = (0.5 + (1.0 + x) / 2.0) * state.pump_speed + motor
        return squeezed * state.displacement * volume

    return _as_effect(leakage_flow=flow)


def _valve(flow):
    """A relief valve that passes flow(MPa above cracking, MPa), in 2e-6 m3/s."""

    def leak(state):
        pressure = np.abs(state.pressure) / 1e6
        return 2e-6 * np.sign(state.pressure) * flow(pressure)

    return _as_effect(leakage_flow=leak)


def _starved(missing, motor=0.0):
    """A unit that pumps lacks 0.1 missing(speed, stroke) of its flow, in rad/s."""

    def lost(state):
        stroke = np.abs(state.displacement_ratio)
        pump = missing(np.abs(state.pump_speed), stroke)
        of_motor = motor * missing(np.abs(state.motor_speed), 1.0)
        pump_pumps = state.pressure * state.displacement_ratio > 0.0
        flow = 0.1 * state.displacement * np.where(pump_pumps, pump, of_motor)
        return np.sign(state.pressure) * flow

    return _as_effect(leakage_flow=lost)


def _fan(power, on):
    """A fan whose torque grows as speed^power, at a part `on` of the oil temperature."""
    return _as_effect(
        engine_drag=lambda state: (
            5.0 * on(state.oil_temperature) * (state.engine_speed / 150.0) ** power
        )
    )


def _creep(torque):
    """Friction that rises with the logarithm of slip: slip grows as exp(T / torque)."""
    return _as_effect(
        output_slip=lambda load: 0.02 * np.expm1(np.minimum(load / torque, 5.0))
    )


PUBLISHED = {
    "relief_valve": [
        # Simscape Fluids: an area in proportion to what is above, a root of pressure.
        *(
            _valve(lambda p, c=c: np.maximum(p - c, 0.0) * np.sqrt(p / 20.0))
            for c in (5.0, 8.0, 12.0)
        ),
        _valve(lambda p: np.maximum(p - 8.0, 0.0) ** 1.5),
    ],
    "inlet_starvation": [
        # Pressure before the inlet falls as flow^2: what fills grows as its root.
        *(
            _starved(
                lambda w, x: np.maximum(w * x - np.sqrt(150.0 * w * x), 0.0), motor
            )
            for motor in (0.0, 1.0)
        ),
        _starved(lambda w, x: x * np.maximum(w - np.sqrt(220.0 * w), 0.0)),
        _starved(lambda w, x: x * np.maximum(w - 200.0, 0.0) ** 2 / 200.0),
    ],
    "fan_drive": [
        _fan(2.0, lambda t: np.clip((t - 55.0) / 20.0, 0.0, 1.0) ** 2),  # viscous
        _fan(2.0, lambda t: 0.5 + 0.5 * np.tanh((t - 65.0) / 5.0)),
        _fan(1.7, lambda t: 1.0 * (t > 65.0)),  # a clutch that slips at high speed
    ],
    "clutch_slip": [_creep(torque) for torque in (150.0, 175.0, 200.0, 250.0)],
    "clutch_drag": [
        _clutch(peak, fall, feed, against)
        for peak in (60.0, 110.0, 160.0)
        for fall in (1.4, 2.2)
        for feed in (0.0, 0.5, 1.0)
        for against in (0.0, 0.5, 0.8)
    ],
    "gear_mesh": [
        _mesh(lambda t, w: t**0.2 * w**-0.2),  # ISO/TR 14179-2, Niemann, Schlenk
        _mesh(lambda t, w: t**-0.4 * w**-0.7),  # ISO/TR 14179-1
        _mesh(lambda t, w: t),  # teeth that bend
        _mesh(lambda t, w: t**0.55),  # ball bearings, M1 of Palmgren
        _mesh(lambda t, w: 0.4 + np.exp(-w / 0.5 * t**-0.13)),  # mixed film
        *(
            _benedict_kelley(decades, power)
            for decades in (0.8, 1.4, 2.0)
            for power in (2, 3)
        ),
    ],
    "pressure_leakage": [
        *(
            _eccentric(pump, motor, lifted)
            for lifted in (1.0, 2.0)
            for pump, motor in ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0))
        ),
        _leak(lambda p, x: (1.0 + 0.3 * p) ** 3 - 1.0),
        _leak(lambda p, x: p**0.8),
    ],
    "planetary_mesh": [
        _row_mesh(lambda t, w: t**0.2 * w**-0.2),  # as of pairs: ISO/TR 14179-2
        _row_mesh(lambda t, w: t**-0.4 * w**-0.7),  # ISO/TR 14179-1
        _row_mesh(lambda t, w: t),
        _row_mesh(lambda t, w: 1.0 + 0.0 * t),
    ],
    "compressibility": [
        _air(share, exponent, stiffening)
        for share in (0.005, 0.02, 0.06)
        for exponent in (1.0, 1.4)
        for stiffening in (0.0, 10.0)
    ],
    "displacement_error": [
        _as_effect(stroke_lag=lambda state, p=p: 0.01 * np.tanh(state.pressure / p))
        for p in (3e6, 8e6, 40e6)
    ],
}


@pytest.fixture(scope="module")
def left():
    """By name, the part of each published form that its family leaves, and what it shows."""
    points = random_points(5, temperature=True)
    motor = BalanceSolver(BASE.stage, BASE.parameters).flow(points)[1].state.motor_speed
    moving = (
        np.abs(motor) > 25.0
    )  # no friction holds it: a jump would be all that one sees
    bench = observe(measure(points.map(lambda row: row[moving])), 0.004)
    system = Transmission(BASE, ["oil_temperature"])
    base = np.append(
        to_scaled(BASE.parameters.to_array()), np.zeros(len(system.base) - 3)
    )
    fit = linearise(Hypothesis(system), bench, base, np.ones(2))

    def predicted(*effects):
        read = system.predict(base, effects, bench.points)[: len(bench.channels)]
        return read / bench.deviation

    def signature(effect):
        return fit.project_out((predicted(effect) - predicted())[None])[0]

    found = {}
    for name, published in PUBLISHED.items():
        forms = [
            form.with_values({form.sizes()[0].name: 0.1 * form.sizes()[0].typical})
            for kind in system.library
            if kind.name == name
            for form in forms_of(kind)
        ]
        family = np.array([signature(form) for form in forms])
        # A form whose threshold no test reaches shows nothing.
        family = family[np.linalg.norm(family, axis=1) > 1e-6]
        family /= np.linalg.norm(family, axis=1)[:, None]
        found[name] = []
        for effect in published:
            shown = signature(effect)
            level = np.linalg.norm(shown)
            found[name].append(
                (float(np.sqrt(1.0 - ((family @ shown).max() / level) ** 2)), level)
            )
    return found


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_family_spans_the_literature(left, name):
    parts = np.array(
        [part for part, level in left[name] if level > 3.0]
    )  # what can be seen
    assert len(parts) >= 2
    assert parts.mean() < 0.2
    assert parts.max() < 0.45
    mean, worst = (f"{100.0 * part:.0f} %" for part in (parts.mean(), parts.max()))
    (row,) = re.findall(rf"^\| `{name}` \|.*$", PAGE, re.M)
    assert row.endswith(f"| {mean} | {worst} |")
