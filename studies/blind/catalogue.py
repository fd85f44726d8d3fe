# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Effects by name, drawn with random shape, and scaled to a wanted shift of efficiency."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hmcvt_core.errors import InputError
from studies.blind import drag, hydrostatics, meters, oil, unknown
from studies.blind.effect import Box, Effect, FloatArray
from studies.blind.plans import reference_points
from studies.blind.twin import BaseTruth, OperatingPoints, Plant, Readings

_KNOWN: tuple[type[Effect], ...] = (
    drag.ChargePump, drag.Churning, drag.ClutchDrag, drag.GearMesh, drag.PlanetaryMesh,
    hydrostatics.PressureLeakage, drag.PressureFriction, hydrostatics.Compressibility,
    hydrostatics.DisplacementError, oil.OilTemperature, meters.TorqueSensor,
    hydrostatics.OrificeLeakage, hydrostatics.StrokeLeakage, drag.BearingSealDrag,
    drag.OutputChurning, hydrostatics.PortPressureDrop,
)
_UNKNOWN: tuple[type[Effect], ...] = (
    unknown.TorsionalResonance, unknown.CasingDeflection, unknown.SwashChatter,
    unknown.ClutchMicroslip,
)
_BY_NAME = {kind.name: kind for kind in (*_KNOWN, *_UNKNOWN)}

#: Effects that the diagnosis contract names, and the further ones it lists.
KNOWN_EFFECTS = tuple(kind.name for kind in _KNOWN)
#: Effects in nobody's library.
UNKNOWN_EFFECTS = tuple(kind.name for kind in _UNKNOWN)

#: Share of the reference plan that an effect may bring to stall before it counts as too large.
_MOST_STALLED = 0.1

_Draw = Callable[[np.random.Generator], dict[str, float]]


def _sense(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


#: Random shape of each effect: what a diagnosis cannot know beforehand.
_SHAPES: dict[str, _Draw] = {
    "charge_pump": lambda r: {
        "cracking_pressure": r.uniform(1.4e6, 2.2e6), "override": r.uniform(0.15, 0.4)},
    "churning": lambda r: {"exponent": r.uniform(2.6, 3.0)},
    "output_churning": lambda r: {"exponent": r.uniform(2.6, 3.0)},
    "clutch_drag": lambda r: {
        "slip_ratio": r.uniform(0.6, 1.2), "peak_slip": r.uniform(70.0, 160.0),
        "decay": r.uniform(1.4, 2.2)},
    "planetary_mesh": lambda r: {"bearing": r.uniform(0.05, 0.25)},
    "pressure_leakage": lambda r: {"exponent": r.uniform(1.6, 2.2)},
    "pressure_friction": lambda r: {
        "hersey": r.uniform(3e-7, 1e-6), "floor": r.uniform(0.2, 0.6)},
    "compressibility": lambda r: {
        "air": r.uniform(0.01, 0.06), "dead_volume": r.uniform(0.3, 0.8)},
    "displacement_error": lambda r: {"sense": _sense(r)},
    "oil_temperature": lambda r: {"film_share": r.uniform(0.75, 0.95)},
    "torque_sensor": lambda r: {"sense": _sense(r)},
    "orifice_leakage": lambda r: {"diameter": r.uniform(2e-4, 6e-4)},
    "stroke_leakage": lambda r: {"exponent": r.uniform(1.3, 1.7)},
    "bearing_seal_drag": lambda r: {"seal_share": r.uniform(0.3, 0.7)},
    "torsional_resonance": lambda r: {
        "centre": r.uniform(105.0, 200.0), "damping": r.uniform(0.03, 0.05)},
    "casing_deflection": lambda r: {
        "stroke_edge": r.uniform(0.35, 0.6), "load_edge": r.uniform(270.0, 340.0),
        "sense": _sense(r)},
    "swash_chatter": lambda r: {
        "centre": _sense(r) * r.uniform(0.3, 0.75), "half_width": r.uniform(0.12, 0.18)},
    "clutch_microslip": lambda r: {"capacity": r.uniform(330.0, 420.0)},
}


@dataclass(frozen=True)
class SizedEffect:
    """An effect scaled to a target, with what it does to efficiency on the reference plan.

    `shift` and `target` are mean absolute shifts of efficiency, over the effect's box when it has
    one, else over the whole range; `capped` says that the target lies beyond the largest physical
    size, or that the plant would stall on more than a tenth of the reference plan before reaching
    it. Points that stall count in no mean.
    """

    effect: Effect
    target: float
    shift: float
    capped: bool


def draw_effect(name: str, rng: np.random.Generator) -> Effect:
    """Draw an effect of random shape and size 1; "gear_mesh:friction" fixes the variant.

    Raises InputError for a name or a variant that does not exist.
    """
    kind_name, _, variant = name.partition(":")
    kind = _BY_NAME.get(kind_name)
    if kind is None:
        raise InputError(f"effect {kind_name!r} does not exist, expected one of {sorted(_BY_NAME)}")
    if variant and variant not in kind.variants:
        raise InputError(f"effect {kind_name!r} has no variant {variant!r}, only {kind.variants}")
    shape = _SHAPES[kind_name](rng) if kind_name in _SHAPES else {}
    if kind.variants:
        drawn = str(rng.choice(kind.variants))
        variant = variant or drawn
    effect = kind(variant=variant, **shape)
    if isinstance(effect, drag.GearMesh):
        uneven = rng.uniform(0.4, 1.6, 6)
        effect = replace(effect, uneven=tuple(float(u) for u in uneven))
    return effect


def size_effect(
    base: BaseTruth, effect: Effect, target: float, temperature_swing: float = 0.0
) -> SizedEffect:
    """Scale an effect, alone in the plant, until efficiency shifts by `target` (a fraction).

    The shift is taken on a fixed reference plan with oil at 60 deg C +- `temperature_swing`. Stops
    within 0.5 % of the target, or at the effect's limit, or just before the plant stalls. Raises
    InputError for a target not above 0.
    """
    if not target > 0.0:
        raise InputError(f"effect {effect.name!r}: target shift is {target}, must be above 0")
    points, plain = _carried(base, reference_points(effect.box or Box(), temperature_swing))
    size, capped = _solve_size(base, effect, target, points, plain)
    sized = replace(effect, size=size)
    shift = float(np.nanmean(np.abs(_shift(base, sized, points, plain))))
    return SizedEffect(sized, target, shift, capped)


def _carried(base: BaseTruth, points: OperatingPoints) -> tuple[OperatingPoints, Readings]:
    """Return the points that the plant carries without effects, and its readings there."""
    plain = Plant(base).read(points)
    if np.all(plain.settled):
        return points, plain
    points = points.select(plain.settled)
    return points, Plant(base).read(points)


def _shift(base: BaseTruth, effect: Effect, points: OperatingPoints, plain: Readings) -> FloatArray:
    read = Plant(base, (effect,)).read(points, start=plain.state)
    return np.asarray(read.efficiency - plain.efficiency)


def _solve_size(
    base: BaseTruth, effect: Effect, target: float, points: OperatingPoints, plain: Readings
) -> tuple[float, bool]:
    """Size that meets the target and whether a limit or a stall keeps it from the target."""

    def miss(size: float) -> float:
        moved = _shift(base, replace(effect, size=size), points, plain)
        if np.mean(np.isnan(moved)) > _MOST_STALLED:
            return float("nan")
        return float(np.nanmean(np.abs(moved))) - target

    low, low_miss = 0.0, -target
    high, stalled = min(effect.limit, 1.0), effect.limit
    high_miss = miss(high)
    while not high_miss >= 0.0:
        if np.isnan(high_miss):
            stalled, high = high, 0.5 * (low + high)
        else:
            low, low_miss = high, high_miss
            wanted = max(1.2 * high * target / (high_miss + target), 1.1 * high)
            high = min(wanted, effect.limit if stalled == effect.limit else 0.5 * (high + stalled))
        if high - low < max(0.01 * high, 1e-6):
            return low, True
        high_miss = miss(high)
    return _regula_falsi(miss, (low, low_miss), (high, high_miss), 0.005 * target), False


def _regula_falsi(
    miss: Callable[[float], float],
    below: tuple[float, float],
    above: tuple[float, float],
    tolerance: float,
) -> float:
    """Illinois variant of regula falsi between a point below the root and one above."""
    (low, low_miss), (high, high_miss) = below, above
    size = high
    for _ in range(60):
        size = low - low_miss * (high - low) / (high_miss - low_miss)
        off = miss(size)
        if abs(off) <= tolerance:
            break
        if off < 0.0:
            low, low_miss, high_miss = size, off, 0.5 * high_miss
        else:
            high, high_miss, low_miss = size, off, 0.5 * low_miss
    return size
