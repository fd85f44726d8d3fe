# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Effects by name, drawn with random shape, and scaled to a wanted shift of efficiency."""

from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from hmcvt_core.errors import InputError
from studies.blind import drag, hydrostatics, meters, unknown
from studies.blind.effect import Effect, FloatArray
from studies.blind.plans import reference_points
from studies.blind.twin import BaseTruth, Plant

_MODULES = {module.__name__ for module in (drag, hydrostatics, meters, unknown)}
_BY_NAME = {
    kind.name: kind for kind in Effect.__subclasses__() if kind.__module__ in _MODULES
}
#: Effects that the diagnosis lists, and those in nobody's library.
KNOWN_EFFECTS = tuple(
    name for name, kind in _BY_NAME.items() if kind.__module__ != unknown.__name__
)
UNKNOWN_EFFECTS = tuple(
    sorted(_BY_NAME.keys() - {*KNOWN_EFFECTS, unknown.BaseMisfit.name})
)
#: Losses that the base may overstate, and the largest size that leaves a loss: named with a minus.
TURNED_EFFECTS = {
    "-pressure_leakage": 0.45,
    "-stroke_leakage": 0.7,
    "-churning": 2.5,
    "-output_churning": 2.5,
}
_MAX_STALLED = 0.1  # share of the reference plan


def draw_effect(name: str, rng: np.random.Generator) -> Effect:
    """Draw an effect of random shape and size 1; "gear_mesh:friction" fixes the variant.

    With a minus before its name, size -1: a loss that the base overstates. Raises InputError for a
    name or a variant that does not exist.
    """
    kind_name, _, variant = name.removeprefix("-").partition(":")
    kind = _BY_NAME.get(kind_name)
    if kind is None:
        raise InputError(
            f"effect {kind_name!r} does not exist, expected one of {sorted(_BY_NAME)}"
        )
    if variant and variant not in kind.variants:
        raise InputError(
            f"effect {kind_name!r} has no variant {variant!r}, only {kind.variants}"
        )
    return kind(-1.0 if name.startswith("-") else 1.0, variant).drawn(rng)


def mean_shift(moved: FloatArray) -> float:
    """Mean absolute value, weighted by itself."""
    size = np.nan_to_num(np.abs(moved))
    return float(np.sum(size**2) / max(np.sum(size), 1e-300))


def size_effect(
    base: BaseTruth, effect: Effect, target: float, temperature_swing: float = 0.0
) -> Effect:
    """Scale an effect, alone in the plant, until efficiency shifts by `target` (a fraction).

    The shift is that on a fixed reference plan with oil at 60 deg C +- `temperature_swing`, where
    the effect acts: the mean of its size, weighted by itself. Points that stall do not count. Stops
    within 0.5 % of the target, or at the effect's limit, or just before the plant stalls on more
    than a tenth of the plan. Raises InputError for a target not above 0.
    """
    if not target > 0.0:
        raise InputError(
            f"effect {effect.name!r}: target shift is {target}, must be above 0"
        )
    points = reference_points(temperature_swing)
    points = points.select(Plant(base).read(points).settled)
    plain = Plant(base).read(points)

    def sized(size: float) -> Effect:
        return replace(effect, size=effect.size * size)

    def miss(size: float) -> float:
        read = Plant(base, (sized(size),)).read(points, start=plain.state)
        if np.mean(read.settled) < 1.0 - _MAX_STALLED:
            return float("nan")
        return mean_shift(read.efficiency - plain.efficiency) - target

    top = effect.limit if effect.size > 0.0 else TURNED_EFFECTS[f"-{effect.name}"]
    low, high, stalls = 0.0, min(top, 1.0), False
    while not (off := miss(high)) >= 0.0:
        if np.isnan(off):
            top, stalls = high, True
        else:
            low = high
        if top - low < 0.01 * top:
            return sized(low)
        high = 0.5 * (low + top) if stalls else min(2.0 * high, top)
    return sized(brentq(miss, low, high, rtol=0.002))
