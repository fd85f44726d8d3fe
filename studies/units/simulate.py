# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Units with hidden losses, in other forms than the candidates of the diagnosis have.

Sizes are parts of the ideal flow or torque at rated pressure and 70 % of the highest speed.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.benches.unit.samples import UnitSamples

Array = NDArray[np.float64]
_SCATTER, _GAIN = 0.001, 0.0015  # of the meters: ISO 4409 class A allows 0.005


@dataclass(frozen=True)
class Place:
    """Pressure / rated, speed / highest, stroke, and the speed itself; arrays of shape (n,)."""

    p: Array
    w: Array
    stroke: Array
    speed: Array


Form = Callable[[Place, Any], tuple[Array | float, Array | float]]
"""Further part of the ideal flow and of the ideal torque that is lost, at size one."""


def _work(at: Place, draw: Any) -> tuple[Array, Array]:
    # A modulus that grows with pressure, and 70 to 100 % of the work of a full stroke returned.
    soft = at.p / (1.0 + draw(0.05, 0.2) * at.p)
    return soft * at.w, -draw(0.7, 1.0) * draw(0.5, 0.8) * soft * at.p * at.stroke


FORMS: Mapping[str, tuple[Form, tuple[float, float]]] = {
    "compressibility": (_work, (0.01, 0.02)),
    "pressure_leakage": (
        lambda at, draw: (  # gaps that open
            at.p * ((1.0 + draw(0.3, 0.8) * at.p) ** 3 - 1.0) / 3.0,
            0.0,
        ),
        (0.015, 0.04),
    ),
    "orifice_leakage": (lambda at, draw: (at.p ** draw(0.53, 0.6), 0.0), (0.01, 0.03)),
    "slow_leakage": (
        lambda at, draw: (at.p * np.exp(-at.speed / draw(15.0, 40.0)), 0.0),
        (0.05, 0.2),
    ),
    "constant_torque": (
        lambda at, draw: (0.0, (0.05 + at.w) ** draw(0.0, 0.06)),
        (0.01, 0.03),
    ),
    "barrel_churning": (lambda at, draw: (0.0, at.w ** draw(1.85, 2.3)), (0.01, 0.04)),
    "pressure_viscosity": (
        lambda at, draw: (  # Barus
            0.0,
            at.w * np.expm1(draw(0.5, 1.0) * at.p),
        ),
        (0.015, 0.03),
    ),
    "pressure_friction": (
        lambda at, draw: (  # Stribeck, another fall
            0.0,
            at.p
            * at.stroke
            * (1.0 + draw(1.0, 4.0) / (1.0 + (at.speed / draw(15.0, 40.0)) ** 2)),
        ),
        (0.01, 0.03),
    ),
    "reference_displacement": (
        lambda at, draw: (at.w * at.stroke, -at.p * at.stroke),
        (0.012, 0.03),
    ),
}


def simulated(names: tuple[str, ...], seed: int) -> UnitSamples:
    """Return a table of 60 to 120 points of a unit that has some effects."""
    rng = np.random.default_rng(seed)
    draw = rng.uniform
    pumps = {"compressibility", "reference_displacement"} & {*names}
    kind = "pump" if pumps else str(rng.choice(["pump", "motor"]))
    displacement = (
        1e-6 * float(np.exp(draw(np.log(28.0), np.log(250.0)))) / (2.0 * np.pi)
    )
    fastest, rated = draw(5.0, 7.5) / np.cbrt(displacement), draw(280e5, 420e5)
    slowest = (
        draw(0.02, 0.15) if {"slow_leakage", "pressure_friction"} & {*names} else 0.3
    )
    strokes = np.array([1.0]) if rng.random() < 0.6 else np.array([0.4, 0.7, 1.0])
    count = int(rng.integers(60, 121)) // len(strokes)
    rows = max(5, count // 9)
    grid = np.meshgrid(
        np.linspace(slowest, 1.0, rows), np.linspace(0.12, 1.0, count // rows), strokes
    )
    w, p, stroke = map(np.ravel, grid)
    at = Place(p, w, stroke, fastest * w)
    # The terms of the paper: leakage, damping, and friction of one percent.
    flow = draw(0.01, 0.04) * p * 0.7
    torque = draw(0.03, 0.08) * w + 0.01 * p * stroke
    for name in names:
        form, sizes = FORMS[name]
        size = draw(*sizes) / (1.0 if name == "reference_displacement" else 0.7)
        lost = form(at, draw)
        flow, torque = flow + size * lost[0], torque + size * lost[1]
    ideal = displacement * fastest * w * stroke, displacement * rated * p * stroke
    losses = displacement * fastest * flow, displacement * rated * torque
    sign = 1.0 if kind == "pump" else -1.0
    read = []
    for loss, whole, way in ((losses[0], ideal[0], -sign), (losses[1], ideal[1], sign)):
        error = _GAIN * rng.standard_normal() + _SCATTER * rng.standard_normal(len(w))
        read.append(loss + way * (whole + way * loss) * error)
    return UnitSamples(
        kind,
        displacement,
        stroke,
        at.speed,
        rated * p,
        read[0],
        read[1],
        source=f"simulated {seed}",
    )
