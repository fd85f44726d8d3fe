# SPDX-License-Identifier: Apache-2.0
"""Simulated annealing: the improved one of section 4.1 and the standard one, same harness."""

import math

import numpy as np
import pytest

from hmcvt_core import InputError
from hmcvt_core.identification.annealing import (
    IMPROVED,
    STANDARD,
    AdaptiveCooling,
    ConstantCooling,
    ConstantDisturbance,
    Schedule,
    ShrinkingDisturbance,
    minimise,
    reflect,
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
    return (x**2 + y - 11.0) ** 2 + (x + y**2 - 7.0) ** 2 + (x - 3.0) ** 2 + (y - 2.0) ** 2


IMPROVED_CHAINS = Schedule(chains=8, moves=60)
STANDARD_CHAINS = Schedule(disturbance=ConstantDisturbance(), cooling=ConstantCooling(),
                           chains=8, moves=60)


@pytest.mark.parametrize("schedule", [IMPROVED_CHAINS, STANDARD_CHAINS])
@pytest.mark.parametrize(("function", "bounds", "optimum"), [
    (sphere, SQUARE, (0.3, -0.7)),
    (rosenbrock, SQUARE, (1.0, 1.0)),
    (himmelblau_tilted, [(-6.0, 6.0), (-6.0, 6.0)], (3.0, 2.0)),
])
@pytest.mark.parametrize("seed", range(3))
def test_finds_known_optimum(schedule, function, bounds, optimum, seed):
    found = minimise(function, bounds, schedule=schedule, seed=seed)
    first = minimise(function, bounds, seed=seed,
                     schedule=Schedule(chains=8, moves=1, threshold=math.inf))
    assert found.value < 2e-2 < first.value  # it moved from where it began
    np.testing.assert_allclose(found.x, optimum, atol=0.15)
    assert found.value == function(found.x[None, :])[0]
    assert found.value == min(function(found.ends))
    np.testing.assert_array_equal(found.x, found.ends[0])
    assert found.stop_reason == "cooled"


def test_same_seed_same_run():
    one, two = (minimise(rosenbrock, SQUARE, seed=7) for _ in range(2))
    np.testing.assert_array_equal(one.x, two.x)
    assert one.history == two.history
    assert one.seed == 7
    assert minimise(rosenbrock, SQUARE, seed=8).history != one.history


def test_global_random_state_is_neither_read_nor_moved():
    np.random.seed(1)
    before = np.random.get_state()[1].copy()
    one = minimise(sphere, SQUARE, seed=3)
    np.testing.assert_array_equal(np.random.get_state()[1], before)
    np.random.seed(2)
    assert minimise(sphere, SQUARE, seed=3).history == one.history


@pytest.mark.parametrize("schedule", [IMPROVED, STANDARD, IMPROVED_CHAINS])
def test_evaluations_count_every_point(schedule):
    asked = []

    def counted(points):
        asked.append(len(points))
        return sphere(points)

    found = minimise(counted, SQUARE, schedule=schedule)
    assert found.evaluations == sum(asked)
    assert found.evaluations <= schedule.chains * (1 + schedule.moves * schedule.generations)


def test_threshold_stops_early():
    """Improvement (1)."""
    states = []
    found = minimise(sphere, SQUARE, schedule=Schedule(threshold=0.05), progress=states.append)
    assert found.stop_reason == "threshold"
    assert found.value < 0.05
    assert all(value >= 0.05 for value in found.history[:-1])
    full = minimise(sphere, SQUARE)
    assert full.stop_reason == "cooled"
    assert found.evaluations < full.evaluations
    assert [state.generation for state in states] == list(range(1, len(states) + 1))
    assert [state.value for state in states] == list(found.history)
    assert states[-1].evaluations == found.evaluations


def test_history_never_rises():
    history = minimise(rosenbrock, SQUARE).history
    assert (np.diff(history) <= 0.0).all()


def test_progress_may_cancel():
    class CancelledError(Exception):
        pass

    def cancel(state):
        if state.generation == 3:
            raise CancelledError

    with pytest.raises(CancelledError):
        minimise(sphere, SQUARE, progress=cancel)


def test_cooling_of_equation_20():
    factors = AdaptiveCooling()(np.array([True, False]))
    np.testing.assert_array_equal(factors, [0.9, 0.7])
    np.testing.assert_array_equal(ConstantCooling()(np.array([True, False])), [0.9, 0.9])


def test_cooling_in_a_run():
    """A flat objective never improves: 0.7 at each step, so log(1e-6) / log(0.7) steps."""
    states = []
    found = minimise(lambda points: np.zeros(len(points)), SQUARE, progress=states.append)
    assert [state.temperature for state in states[:3]] == pytest.approx([0.7, 0.49, 0.343])
    assert len(found.history) == math.ceil(math.log(1e-6) / math.log(0.7)) == 39


def test_generations_are_cooling_steps_at_the_slower_rate():
    # docs/theory.md: 0.9^132 < 1e-6 < 0.9^131.
    assert IMPROVED.generations == 132


@pytest.mark.parametrize(("generation", "shrink"), [(0, 1.0), (66, 1.0 - 66 / 134), (132, 2 / 134)])
def test_disturbance_of_equation_19(generation, shrink):
    """L_x = 0.1 of the width, rand - 0.5 in +-0.5, shrunk by 1 - i / (N + 2), N = 132."""
    rng = np.random.default_rng(0)
    centre, width = np.zeros((20000, 2)), np.array([4.0, 0.01])
    moved = ShrinkingDisturbance()(centre, width, generation, 132, rng) / width
    reach = 0.1 * 0.5 * shrink
    assert np.abs(moved).max() <= reach
    assert np.abs(moved).max() > 0.99 * reach
    # Uniform: mean 0, variance (2 reach)^2 / 12; the bands are five standard errors wide.
    assert abs(moved.mean()) < 5.0 * reach / math.sqrt(3.0 * moved.size)
    assert moved.var() == pytest.approx(reach**2 / 3.0, rel=0.03)
    constant = ConstantDisturbance()(centre, width, generation, 132, rng) / width
    assert np.abs(constant).max() == pytest.approx(0.05, rel=0.01)


def test_bounds_reflect():
    low, high = np.zeros(1), np.ones(1)
    given = np.array([[-0.2], [0.3], [1.4], [2.3], [-1.1]])
    # By hand: folded at 0 and 1 as often as needed.
    np.testing.assert_allclose(reflect(given, low, high)[:, 0], [0.2, 0.3, 0.6, 0.3, 0.9])


def test_trials_do_not_pile_up_on_a_bound():
    """On a flat objective the walk stays uniform: the outer tenths get no more than the rest."""
    seen = []

    def flat(points):
        seen.append(points[:, 0].copy())
        return np.zeros(len(points))

    schedule = Schedule(disturbance=ConstantDisturbance(0.5), cooling=ConstantCooling(),
                        chains=64, moves=20)
    minimise(flat, [(2.0, 5.0)], schedule=schedule, seed=5)
    trials = np.concatenate(seen)
    assert trials.min() >= 2.0
    assert trials.max() <= 5.0
    assert np.isin(trials, (2.0, 5.0)).mean() < 1e-4
    share = np.histogram(trials, bins=10, range=(2.0, 5.0))[0] / trials.size
    np.testing.assert_allclose(share, 0.1, atol=0.01)


def test_nan_is_infinitely_bad():
    """Half the square has no answer; the lowest point of the rest is found."""
    def half(points):
        return np.where(points[:, 0] < 0.5, np.nan, sphere(points))

    found = minimise(half, SQUARE, schedule=IMPROVED_CHAINS)
    np.testing.assert_allclose(found.x, (0.5, -0.7), atol=0.1)
    assert np.isfinite(found.history).any()


def test_no_answer_anywhere():
    found = minimise(lambda points: np.full(len(points), np.nan), SQUARE)
    assert found.value == math.inf
    assert found.stop_reason == "cooled"


def test_start_is_used():
    asked = []

    def counted(points):
        asked.append(points.copy())
        return sphere(points)

    minimise(counted, SQUARE, start=(1.5, -1.5), schedule=Schedule(chains=3))
    np.testing.assert_array_equal(asked[0], [[1.5, -1.5]] * 3)


@pytest.mark.parametrize(("settings", "message"), [
    ({"initial_temperature": 1e-7}, "need 0 < final < initial"),
    ({"final_temperature": 0.0}, "need 0 < final < initial"),
    ({"initial_temperature": math.inf}, "both finite"),
    ({"initial_temperature": math.nan}, "need 0 < final < initial"),
    ({"moves": 0}, "moves = 0 is not at least 1"),
    ({"chains": 0}, "chains = 0 is not at least 1"),
])
def test_schedule_is_checked(settings, message):
    with pytest.raises(InputError, match=message):
        Schedule(**settings)


@pytest.mark.parametrize(("bounds", "start", "message"), [
    ([(1.0, 0.0)], None, r"need finite \(lower, upper\) rows"),
    ([(0.0, math.inf)], None, r"need finite \(lower, upper\) rows"),
    ([0.0, 1.0], None, r"need finite \(lower, upper\) rows"),
    ([(0.0, 1.0)], (0.5, 0.5), r"start has shape \(2,\), needs \(1, 1\)"),
    ([(0.0, 1.0)], (2.0,), r"start = \[\[2\.0\]\] leaves the bounds"),
    ([(0.0, 1.0)], (math.nan,), r"leaves the bounds"),
])
def test_bounds_and_start_are_checked(bounds, start, message):
    with pytest.raises(InputError, match=message):
        minimise(sphere, bounds, start=start)
