# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a campaign hides: which effects, of which form, and how large."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from hmcvt_core.errors import InputError
from studies.blind.bench.layouts import Machine
from studies.blind.bench.listed_losses import LISTED_LOSSES
from studies.blind.bench.plant import Settings, State
from studies.blind.bench.unlisted_losses import UNLISTED_LOSSES, OilFan, ReliefValve
from studies.blind.catalogue import (
    KNOWN_EFFECTS,
    TURNED_EFFECTS,
    UNKNOWN_EFFECTS,
    draw_effect,
    mean_shift,
)
from studies.blind.effect import Effect

#: Kinds of campaign, with how often each occurs among all.
KINDS = {
    "single": 6,
    "pair": 4,
    "triple": 1,
    "nothing": 3,
    "base_off": 3,
    "unlisted": 3,
    "wrong_sign": 1,
    "newly_listed": 2,
}
#: Kinds of a run that does not choose any.
USUAL_KINDS = tuple(kind for kind in KINDS if kind != "newly_listed")
SETS = {"single": 1, "pair": 2, "triple": 3}
#: Shift of the efficiency that an effect makes where it acts, drawn evenly in its logarithm.
_SHIFTS = (0.007, 0.03)
_MAX_STALLED = 0.1
#: Share of listed effects that take a form of `listed_losses`.
_OWN_FORM = 0.5
#: Tests on which an effect is sized, about so many.
_SIZED_ON = 32


@dataclass(frozen=True)
class Hidden:
    """An effect before it is sized: its form, and the shift it is to make."""

    effect: Effect
    shift: float


def draw_hidden(kind: str, rng: np.random.Generator) -> list[Hidden]:
    """Draw the effects of a kind of campaign, each of random shape.

    Raises:
        InputError: there is no such kind.
    """
    if kind not in KINDS:
        raise InputError(f"kind {kind!r} does not exist, expected one of {list(KINDS)}")
    names: list[str] = []
    if kind in SETS:
        names = [
            str(name) for name in rng.choice(KNOWN_EFFECTS, SETS[kind], replace=False)
        ]
    elif kind == "unlisted":
        names = [str(rng.choice([*UNLISTED_LOSSES, *UNKNOWN_EFFECTS]))]
    elif kind == "newly_listed":
        listed = [name for name, loss in UNLISTED_LOSSES.items() if loss.listed_as]
        names = [str(rng.choice(listed))]
    elif kind == "wrong_sign":
        names = [str(rng.choice(list(TURNED_EFFECTS)))]
    hidden = []
    for name in names:
        low, high = np.log(_SHIFTS)
        shift = float(np.exp(rng.uniform(low, high)))
        hidden.append(Hidden(_drawn(name, rng), shift))
    return hidden


def _drawn(name: str, rng: np.random.Generator) -> Effect:
    """Draw an effect: a listed one in a form of the twin or in one of the bench's own."""
    if name in UNLISTED_LOSSES:
        return UNLISTED_LOSSES[name]().drawn(rng)
    own_form = rng.random() < _OWN_FORM
    if own_form and name in LISTED_LOSSES:
        return LISTED_LOSSES[name]().drawn(rng)
    return draw_effect(name, rng)


def placed(effect: Effect, state: State, settings: Settings) -> Effect:
    """Return an effect whose threshold lies within what a campaign reaches."""
    if isinstance(effect, ReliefValve):
        cracking = np.nanquantile(np.abs(state.pressure), effect.quantile)
        return replace(effect, cracking=float(cracking))
    if isinstance(effect, OilFan):
        mean = float(np.mean(settings.oil_temperature))
        return replace(effect, mean_temperature=mean)
    return effect


def sized(
    machine: Machine,
    hidden: Hidden,
    settings: Settings,
    stage: np.ndarray,
    factor: float = 1.0,
) -> Effect:
    """Scale an effect, alone in a machine, until the efficiency shifts by what it is to.

    The shift is the mean of its size over some of the tests, weighted by itself. Stops at the
    effect's limit, or just before the machine stalls on more than a tenth of the tests.

    Args:
        machine: without effects.
        hidden: the effect with its shift.
        settings: of the tests.
        stage: of each test.
        factor: times the shift.
    """
    some = np.arange(0, len(settings), max(1, len(settings) // _SIZED_ON))
    tests = settings.select(some)
    plain = machine.run(tests, stage[some]).efficiency(tests.engine_speed)
    target = factor * hidden.shift

    def scaled(size: float) -> Effect:
        return replace(hidden.effect, size=hidden.effect.size * size)

    def miss(size: float) -> float:
        effect = scaled(size)
        state = replace(machine, effects=(effect,)).run(tests, stage[some])
        if np.mean(state.runs) < 1.0 - _MAX_STALLED:
            return float("nan")
        efficiency = _read_efficiency(effect, state, tests)
        moved = np.where(state.runs, efficiency - plain, 0.0)
        return mean_shift(moved) - target

    return scaled(_size_without_stall(miss, _largest(hidden.effect)))


def _read_efficiency(effect: Effect, state: State, tests: Settings) -> np.ndarray:
    """Efficiency by meters that an effect may put out of true."""
    engine, output = effect.read(state.engine_torque, state.output_torque)
    power = output * state.output_speed
    return np.asarray(power / (engine * tests.engine_speed))


def _largest(effect: Effect) -> float:
    if effect.size > 0.0:
        return effect.limit
    return TURNED_EFFECTS[f"-{effect.name}"]


def _size_without_stall(miss: Callable[[float], float], top: float) -> float:
    """Return the size at which nothing is missed, or the largest that does not stall."""
    low = 0.0
    high = min(top, 0.25)
    stalls = False
    while True:
        missed = miss(high)
        if missed >= 0.0:
            return float(brentq(miss, low, high, rtol=0.01, xtol=1e-6))
        if np.isnan(missed):
            top = high
            stalls = True
        else:
            low = high
        if top - low < 0.02 * top:
            return low
        high = 0.5 * (low + top) if stalls else min(2.0 * high, top)
