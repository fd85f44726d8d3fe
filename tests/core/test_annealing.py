# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Simulated annealing: the improved one of section 4.1 and the standard one, same harness."""

import itertools
import math

import numpy as np
import pytest

from hmcvt_core import InputError
from hmcvt_core.identification.annealing import (
    Schedule,
    minimise,
    reflect,
    with_steps,
    with_temperature,
)

SQUARE = [(-2.0, 2.0), (-2.0, 2.0)]


def sphere(points):
    """Lowest at (0.3, -0.7): 0."""
    return (points[:, 0] - 0.3) ** 2 + (points[:, 1] + 0.7) ** 2


def rosenbrock(points):
    """Lowest at (1, 1): 0."""
    x, y = points.T
    return (1.0 - x) ** 2 + 100.0 * (y - x**2) ** 2


def himmelblau_tilted(points):
    """Four valleys; the tilt leaves one lowest, at (3, 2) (by hand: both squares vanish)."""
    x, y = points.T
    return (
        (x**2 + y - 11.0) ** 2 + (x + y**2 - 7.0) ** 2 + (x - 3.0) ** 2 + (y - 2.0) ** 2
    )


class Recorder:
    """A function that notes where it is asked."""

    def __init__(self, function):
        self.function, self.asked = function, []

    def __call__(self, points):
        self.asked.append(points.copy())
        return self.function(points)


def never(steps, slow_steps):
    """The standard algorithm's disturbance: the same range from first to last."""
    return np.zeros_like(slow_steps)


IMPROVED_CHAINS = Schedule(chains=8, moves=20)
STANDARD_CHAINS = Schedule(shrink=never, cooling=(0.9, 0.9), chains=8, moves=20)


# How near each comes: the improved one ends in small steps, the standard one in wide ones.
@pytest.mark.parametrize(
    ("schedule", "near"), [(IMPROVED_CHAINS, 1e-3), (STANDARD_CHAINS, 2e-2)]
)
@pytest.mark.parametrize(
    ("function", "bounds", "optimum"),
    [
        (sphere, SQUARE, (0.3, -0.7)),
        (rosenbrock, SQUARE, (1.0, 1.0)),
        (himmelblau_tilted, [(-6.0, 6.0), (-6.0, 6.0)], (3.0, 2.0)),
    ],
)
def test_finds_known_optimum(schedule, near, function, bounds, optimum):
    for seed in range(2):
        found = minimise(function, bounds, schedule=schedule, seed=seed)
        first = minimise(
            function,
            bounds,
            seed=seed,
            schedule=Schedule(chains=8, moves=1, threshold=math.inf),
        )
        assert found.value < near < first.value  # it moved from where it began
        np.testing.assert_allclose(found.ends[0], optimum, atol=0.15)
        assert found.value == function(found.ends[:1])[0]
        np.testing.assert_array_equal(
            function(found.ends), np.sort(function(found.ends))
        )


def test_same_seed_same_run():
    one, two = (minimise(rosenbrock, SQUARE, seed=7) for _ in range(2))
    assert one.history == two.history
    assert minimise(rosenbrock, SQUARE, seed=8).history != one.history
    assert (np.diff(one.history) <= 0.0).all()


def test_threshold_stops_early():
    """Improvement (1)."""
    states = []
    found = minimise(
        sphere, SQUARE, schedule=Schedule(threshold=0.05), progress=states.append
    )
    assert found.stop_reason == "threshold"
    assert found.value < 0.05
    assert all(value >= 0.05 for value in found.history[:-1])
    full = minimise(sphere, SQUARE)
    assert full.stop_reason == "cooled"
    assert found.evaluations < full.evaluations
    assert [len(state.history) for state in states] == list(range(1, len(states) + 1))
    assert [state.value for state in states] == list(found.history)
    assert [sphere(state.ends[:1])[0] for state in states] == list(found.history)
    assert states[-1].evaluations == found.evaluations


def flat(points):
    """Never improves."""
    return np.zeros(len(points))


_count = itertools.count()


def falling(points):
    """Improve always."""
    return np.array([-float(next(_count)) for _ in points])


@pytest.mark.parametrize(
    ("objective", "factor", "steps"), [(flat, 0.7, 39), (falling, 0.9, 132)]
)
def test_cooling_of_equation_20(objective, factor, steps):
    """By hand: log(1e-6) / log(0.7) = 38.7 and log(1e-6) / log(0.9) = 131.1."""
    states = []
    found = minimise(objective, SQUARE, progress=states.append)
    assert [state.temperature for state in states[:3]] == pytest.approx(
        [factor, factor**2, factor**3]
    )
    assert len(found.history) == steps
    assert (
        len(minimise(objective, SQUARE, schedule=Schedule(cooling=(0.9, 0.9))).history)
        == 132
    )


def test_each_chain_cools_by_itself():
    """One chain improves in every step, the other never: it rests while the first goes on."""

    def half(points):
        return np.where(points[:, 0] < 20.0, 0.0, falling(points))

    asked = Recorder(half)
    minimise(
        asked,
        [(0.0, 40.0)],
        schedule=Schedule(chains=2, moves=1),
        start=[[0.0], [40.0]],
    )
    assert [len(points) for points in asked.asked[1:]] == [2] * 39 + [1] * (132 - 39)


@pytest.mark.parametrize(
    ("shrink", "last"),
    [
        # log 0.7 / log 0.9 = 3.3853: 38 steps of 0.7 cool as much as 128.64 of 0.9.
        (with_temperature, 1.0 - 128.64 / 134),
        (with_steps, 1.0 - 38 / 134),
        (never, 1.0),
    ],
)
def test_disturbance_of_equation_19(shrink, last):
    """x + L_x (rand - 0.5) (1 - i / (N + 2)), L_x = 0.1 of the width, N = 132."""
    asked = Recorder(flat)
    bounds = np.array([[-100.0, 100.0], [-0.1, 0.1]])
    # A flat objective takes every move: what is asked differs by one step.
    minimise(
        asked,
        bounds,
        start=[0.0, 0.0],
        schedule=Schedule(shrink=shrink, chains=2000, moves=1),
    )
    assert len(asked.asked) == 1 + 39
    width = bounds[:, 1] - bounds[:, 0]
    for step, factor in ((1, 1.0), (39, last)):
        before, after = asked.asked[step - 1], asked.asked[step]
        inside = (np.abs(before) < 0.44 * width).all(axis=1)
        moved = ((after - before) / width)[inside]
        reach = 0.1 * 0.5 * factor
        assert 0.99 * reach < np.abs(moved).max() <= reach * (1.0 + 1e-4)
        # Uniform: mean 0, variance reach^2 / 3; the band is five standard errors wide.
        assert abs(moved.mean()) < 5.0 * reach / math.sqrt(3.0 * moved.size)
        assert moved.var() == pytest.approx(reach**2 / 3.0, rel=0.06)


@pytest.mark.parametrize("temperature", [1.0, 0.5])
def test_worse_points_are_accepted_by_metropolis_rule(temperature):
    """P = exp(-rise / t) for a first move that costs 1."""
    costs = iter((0.0, 1.0, 1.0))
    asked = Recorder(lambda points: np.full(len(points), next(costs)))

    def still_after_the_first(steps, slow_steps):
        return np.full_like(slow_steps, steps * (schedule.generations + 2))

    schedule = Schedule(
        shrink=still_after_the_first,
        chains=20_000,
        moves=1,
        initial_temperature=temperature,
        final_temperature=0.6 * temperature,
    )
    minimise(asked, SQUARE, start=[0.0, 0.0], schedule=schedule)
    _, first, second = asked.asked
    np.testing.assert_array_equal(second, np.where((second == first), first, 0.0))
    # 20,000 chains know the share to 0.0034.
    assert (second == first).all(axis=1).mean() == pytest.approx(
        math.exp(-1.0 / temperature), abs=0.015
    )


def narrow_valley(points):
    """Lowest at (0.3, -0.7): 0; a thousand times as long as wide, across the axes."""
    along = points[:, 0] - 0.3 + points[:, 1] + 0.7
    across = points[:, 0] - 0.3 - points[:, 1] - 0.7
    return along**2 + 1e6 * across**2


def test_rounds_follow_a_narrow_valley():
    """Later rounds measure eq. (19) along the valley; one round gets stuck in its width."""
    for seed in range(5):
        rounds = Schedule(chains=40, moves=2, rounds=6)
        found = minimise(narrow_valley, SQUARE, schedule=rounds, seed=seed)
        assert found.value < 1e-6 and found.stop_reason == "cooled"
        np.testing.assert_allclose(found.ends[0], (0.3, -0.7), atol=1e-3)
        one = minimise(
            narrow_valley, SQUARE, schedule=Schedule(chains=40, moves=6), seed=seed
        )
        assert one.value > 100.0 * found.value
        assert (np.diff(found.history) <= 0.0).all()


def test_rounds_stay_within_the_bounds():
    asked = Recorder(lambda points: points.sum(axis=1))
    found = minimise(asked, SQUARE, schedule=Schedule(chains=20, moves=2, rounds=4))
    points = np.concatenate(asked.asked)
    assert (np.abs(points) <= 2.0).all() and found.evaluations == len(points)
    np.testing.assert_allclose(found.ends[0], (-2.0, -2.0), atol=1e-3)


@pytest.mark.parametrize("value", [0.0, math.nan])
def test_ends_that_span_no_domain_end_the_rounds(value):
    found = minimise(
        lambda points: np.full(len(points), value), SQUARE, schedule=Schedule(rounds=3)
    )
    assert found.stop_reason == "cooled" and len(found.history) == 39


def test_threshold_stops_a_later_round():
    schedule = Schedule(chains=10, moves=2, rounds=8, threshold=1e-12)
    found = minimise(sphere, SQUARE, schedule=schedule)
    assert found.stop_reason == "threshold" and found.value < 1e-12


def test_bounds_reflect():
    low, high = np.zeros(1), np.ones(1)
    given = np.array([[-0.2], [0.3], [1.4], [2.3], [-1.1]])
    # By hand: folded at 0 and 1 as often as needed.
    np.testing.assert_allclose(
        reflect(given, low, high)[:, 0], [0.2, 0.3, 0.6, 0.3, 0.9]
    )


def test_nan_is_infinitely_bad():
    """Half the square has no answer; the lowest point of the rest is found."""

    def half(points):
        return np.where(points[:, 0] < 0.5, np.nan, sphere(points))

    found = minimise(half, SQUARE, schedule=IMPROVED_CHAINS)
    np.testing.assert_allclose(found.ends[0], (0.5, -0.7), atol=0.01)
    nowhere = minimise(lambda points: np.full(len(points), np.nan), SQUARE)
    assert (nowhere.value, nowhere.stop_reason) == (math.inf, "cooled")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"initial_temperature": 1e-7}, "need 0 < final < initial"),
        ({"final_temperature": 0.0}, "need 0 < final < initial"),
        ({"initial_temperature": math.inf}, "both finite"),
        ({"initial_temperature": math.nan}, "need 0 < final < initial"),
        (
            {"cooling": (0.9, 1.0)},
            r"cooling = \(0\.9, 1\.0\): need factors above 0 and below 1",
        ),
        ({"moves": 0}, "moves = 0 is not a whole number of at least 1"),
        ({"chains": 0}, "chains = 0 is not a whole number of at least 1"),
        ({"moves": math.nan}, "moves = nan is not a whole number of at least 1"),
        ({"rounds": 0}, "rounds = 0 is not a whole number of at least 1"),
    ],
)
def test_schedule_is_checked(settings, message):
    with pytest.raises(InputError, match=message):
        Schedule(**settings)
