# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""One lookup, many at once and the optimum, beside a table of SciPy and brute force."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects import library
from studies.page import Goal, table

from .timing import Section, at_least, at_most, in_turns, ratio, spread

Array = NDArray[np.float64]

SPEEDS, LOADS = (
    (78.5, 230.0),
    (50.0, 400.0),
)  # of the engine [rad/s], of the table [N m]
NODES = (41, 31, 31)
HOLDS = {"engine_speed": 0.15e-3, "output_speed": 1e-3}
"""What is held, and how long an optimum may take [s]."""

_ZOOMS, _WITHIN = 3, 25  # each zoom looks between the neighbours of the best stroke
_BISECTIONS = 44


class Points(NamedTuple):
    """Operating points, shape (n,): ratio, speed [rad/s], torque [N m]; output speed, power."""

    displacement_ratio: Array
    engine_speed: Array
    load_torque: Array
    output_speed: Array
    power: Array


def draw(model: hmcvt.EfficiencyModel, count: int, seed: int) -> Points:
    """Draw operating points that the model can carry."""
    rng = np.random.default_rng(seed)
    at = (
        rng.uniform(-1.0, 1.0, 2 * count),
        rng.uniform(*SPEEDS, 2 * count),
        rng.uniform(*LOADS, 2 * count),
    )
    output = model.output_speed(*at)
    carried = np.flatnonzero(np.isfinite(model.efficiency(*at)))[:count]
    return Points(*(values[carried] for values in (*at, output, at[1] * at[2])))


def section(model: hmcvt.EfficiencyModel, quick: bool) -> Section:
    """Time and check all of it."""
    lookups, optima = _lookups(model, quick), _optima(model, quick)
    return Section([*lookups.goals, *optima.goals], {**lookups.values, **optima.values})


# --- lookups --------------------------------------------------------------------------------------


def _lookups(model: hmcvt.EfficiencyModel, quick: bool) -> Section:
    axes = [
        np.linspace(*ends, nodes)
        for ends, nodes in zip(((-1.0, 1.0), SPEEDS, LOADS), NODES, strict=True)
    ]
    interpolated = RegularGridInterpolator(axes, model.efficiency_map(*axes).efficiency)
    some = np.stack(draw(model, 200, seed=1)[:3], axis=-1).tolist()
    many = draw(model, 100_000 if quick else 1_000_000, seed=2)[:3]
    rows = np.stack(many, axis=-1)
    lookup = model.efficiency

    def ours() -> None:
        for displacement_ratio, engine_speed, load_torque in some:
            lookup(displacement_ratio, engine_speed, load_torque)

    def theirs() -> None:
        for point in some:
            interpolated(point)

    one = in_turns(15, {"ours": ours, "table": theirs}, len(some))
    batch = in_turns(
        5,
        {"ours": lambda: lookup(*many), "table": lambda: interpolated(rows)},
        len(rows),
    )
    off = 100.0 * np.abs(interpolated(rows) - lookup(*many))
    return Section(
        [
            at_most(
                "one lookup", spread([1e6 * spent for spent in one["ours"]]), 2.0, " us"
            ),
            at_least("one lookup: table / ours", ratio(one, "table", "ours"), 30.0),
            at_least(
                f"batch of {len(rows):,} points: table / ours",
                ratio(batch, "table", "ours"),
                2.0,
            ),
        ],
        {
            "nodes": NODES,
            "off": np.nanmax(off),
            "batch_time": 1e9 * np.median(batch["ours"]),
        },
    )


# --- optimum --------------------------------------------------------------------------------------


def _optima(model: hmcvt.EfficiencyModel, quick: bool) -> Section:
    given = np.stack(draw(model, 50, seed=3), axis=-1).tolist()
    goals = []
    for hold, limit in HOLDS.items():

        def all_of_them(hold: str = hold) -> None:
            for _, speed, torque, output, _ in given:
                model.optimal_displacement_ratio(
                    speed, torque, hold=hold, output_speed=output
                )

        times = in_turns(7, {"ours": all_of_them}, len(given))["ours"]
        goals.append(
            at_most(
                f"one optimum, {hold.replace('_', ' ')} held",
                spread([1e3 * spent for spent in times]),
                1e3 * limit,
                " ms",
            )
        )
    rows = []
    plain = draw(model, 100 if quick else 2000, seed=4)
    kinds = library()
    each = 2 if quick else -(-500 // len(kinds))
    for hold in HOLDS:
        lost = _lost(model, plain, hold)
        goals.append(_accuracy(f"optimum without effects, {_words(hold)}", lost, 1e-6))
        rows.append([_words(hold), "none", *_spread_of(lost)])
        found = {}
        for seed, kind in enumerate(kinds):
            effect = kind(**{item.name: item.typical for item in kind.parameters()})
            with_effect = replace(model, effects=(effect,)).without_meters()
            found[f"{kind.name} {kind.form}".strip()] = _lost(
                with_effect, draw(with_effect, each, seed=10 + seed), hold
            )
        goals.append(
            _accuracy(
                f"optimum with effects, {_words(hold)}",
                np.concatenate(list(found.values())),
                2e-4,
            )
        )
        worst = max(found, key=lambda name: found[name].max())
        rows.append(
            [
                _words(hold),
                f"each of {len(kinds)}, at its typical size; worst: {worst}",
                *_spread_of(np.concatenate(list(found.values()))),
            ]
        )
    return Section(
        goals,
        {
            "zooms": _ZOOMS,
            "optima": table(
                ("held", "effects", "points", "lost, median", "99 %", "largest"), rows
            ),
        },
    )


def _lost(model: hmcvt.EfficiencyModel, given: Points, hold: str) -> Array:
    """Efficiency by which our optimum stays below that of brute force, shape (n,)."""
    ours = model.optimal_displacement_ratio(
        given.engine_speed,
        given.load_torque,
        hold=hold,
        output_speed=given.output_speed,
        engine_speed_limits=SPEEDS,
    )
    best = brute_force(model, given, hold)
    return np.maximum(best - np.nan_to_num(ours.efficiency), 0.0)


def brute_force(model: hmcvt.EfficiencyModel, given: Points, hold: str) -> Array:
    """Highest efficiency at each point over all strokes, shape (n,)."""
    strokes = np.linspace(-1.0, 1.0, 401)[:, None] * np.ones(len(given.power))
    for _ in range(_ZOOMS + 1):
        speed = (
            np.broadcast_to(given.engine_speed, strokes.shape)
            if hold == "engine_speed"
            else _speed_for(model, strokes, given)
        )
        found = np.nan_to_num(model.efficiency(strokes, speed, given.power / speed))
        # Where the output cannot be had within the engine's limits there is no answer.
        if hold == "output_speed":
            reached = model.output_speed(strokes, speed, given.power / speed)
            found[~(np.abs(reached / given.output_speed - 1.0) < 1e-9)] = 0.0
        at = np.clip(found.argmax(axis=0), 1, len(strokes) - 2)
        low, high = (
            np.take_along_axis(strokes, (at + step)[None], axis=0)[0]
            for step in (-1, 1)
        )
        best = found.max(axis=0)
        strokes = low + (high - low) * np.linspace(0.0, 1.0, _WITHIN)[:, None]
    return best


def _speed_for(model: hmcvt.EfficiencyModel, strokes: Array, given: Points) -> Array:
    """Engine speed at which each stroke gives the output speed, or a limit of the engine."""
    low, high = (np.full(strokes.shape, limit) for limit in SPEEDS)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        above = (
            model.output_speed(strokes, middle, given.power / middle)
            > given.output_speed
        )
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return 0.5 * (low + high)


def _accuracy(what: str, lost: Array, limit: float) -> Goal:
    return Goal(
        f"{what}: largest loss against brute force at {len(lost)} points",
        f"at most {limit:g}",
        f"{lost.max():.2g}",
        bool(lost.max() <= limit),
    )


def _spread_of(lost: Array) -> list[str]:
    return [
        str(len(lost)),
        *(f"{np.percentile(lost, part):.1g}" for part in (50, 99, 100)),
    ]


def _words(hold: str) -> str:
    return f"{hold.replace('_', ' ')} held"
