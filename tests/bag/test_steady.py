# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Steady windows and the uncertainty of a mean: pure functions on arrays, no bags."""

import math

import numpy as np
import pytest

from hmcvt_tools.steady import (
    Channels,
    Steadiness,
    effective_size,
    find_windows,
    ratio_of_means,
)

from .simulated import RATE, correlated

LIMITS = Steadiness()


def _find(values, drift=0.01, scatter=0.05, relative=True, limits=LIMITS, rate=RATE):
    values = np.asarray(values, dtype=float)
    time = np.arange(len(values)) / rate
    channel = Channels(values[None], *map(np.atleast_1d, (drift, scatter, relative)))
    return [
        (time[window.start], time[window.stop - 1])
        for window in find_windows(time, channel, limits)
    ]


def _flat(seconds, value=100.0):
    return np.full(round(seconds * RATE), value)


@pytest.mark.parametrize("seconds, count", [(4.7, 0), (5.1, 1)])
def test_a_window_lasts_min_duration_at_least(seconds, count):
    ramp = np.linspace(50.0, 100.0, 200)
    values = np.concatenate([ramp, _flat(seconds), ramp[::-1]])
    # The blocks do not start with the plateau: let them be short.
    assert len(_find(values, limits=Steadiness(block=0.1))) == count


def test_a_step_parts_two_windows():
    first, second = _find(np.concatenate([_flat(10.5), _flat(10.5, 104.0)]))
    assert first[1] < 10.5 <= second[0]
    assert first[1] - first[0] > 9.0 and second[1] - second[0] > 8.0
    assert (
        len(_find(np.concatenate([_flat(10.5), _flat(10.5, 100.9)]))) == 1
    )  # within the limit


def test_the_tail_of_a_transient_is_left_out():
    time = np.arange(0.0, 20.0, 1.0 / RATE)
    values = 100.0 + 50.0 * np.exp(-time / 1.5)
    (window,) = _find(values)
    first_block = values[(time >= window[0]) & (time < window[0] + 1.0)]
    assert first_block.mean() < 101.0
    # And no more than needed: e^-t/1.5 is below 1 % of 100 after 6 s.
    assert window[0] < 7.0


def test_the_longest_plateau_is_not_cut_by_a_run_from_the_transient():
    # From 2 s on everything is within 1 % of 101.5 as well: a greedy search would start there.
    tail = np.concatenate([_flat(2.0, 103.0), _flat(3.0, 101.8), _flat(12.0, 101.0)])
    assert _find(tail, drift=0.007)[0][0] == pytest.approx(5.0)


HUNTING = 100.0 + 10.0 * np.sin(4.0 * np.pi * np.arange(0.0, 10.0, 1.0 / RATE))
NOISY = 100.0 + np.random.default_rng(0).normal(0.0, 2.0, 1000)  # over more than 10
STEP = np.concatenate([_flat(6.0, 0.0), _flat(6.0, 0.02)])
SLOW = {"values": np.full(40, 100.0), "rate": 2.0}


@pytest.mark.parametrize(
    ("count", "given"),
    [
        (1, {"values": _flat(20.0)}),
        (0, {"values": np.linspace(100.0, 200.0, 1000)}),
        # Scatter is judged within blocks, drift between their means; an absolute one has no scale.
        (0, {"values": HUNTING, "scatter": 0.05}),
        (1, {"values": HUNTING, "scatter": 0.08}),
        (1, {"values": NOISY}),
        *(
            (
                2 if drift < 0.02 else 1,
                {"values": offset + STEP, "drift": drift, "relative": False},
            )
            for offset in (0.0, 1e6)
            for drift in (0.01, 0.03)
        ),
        # Too few readings, of all and in a block.
        *((0, {"values": np.full(few, 100.0)}) for few in (0, 1, 2, 10)),
        (0, SLOW),
        (1, SLOW | {"limits": Steadiness(10.0, 2.0)}),
    ],
)
def test_count_of_windows(count, given):
    assert len(_find(**given)) == count


def test_every_channel_has_to_be_settled():
    time = np.arange(0.0, 20.0, 1.0 / RATE)
    still, late = np.full(len(time), 100.0), np.where(time < 8.0, 100.0 + time, 150.0)
    (window,) = find_windows(
        time,
        Channels(
            np.stack([still, late]),
            np.full(2, 0.01),
            np.full(2, 0.05),
            np.ones(2, bool),
        ),
        LIMITS,
    )
    assert time[window.start] == pytest.approx(8.0)


@pytest.mark.parametrize("constant", [0.001, 0.1, 0.3])
def test_effective_size_of_first_order_noise(constant):
    rng = np.random.default_rng(1)
    sizes = [effective_size(correlated(rng, 1500, 1.0, constant)) for _ in range(200)]
    keep = math.exp(-1.0 / (RATE * constant))
    expected = 1500 * (1.0 - keep) / (1.0 + keep)
    assert np.median(sizes) == pytest.approx(expected, rel=0.1)


def test_effective_size_at_the_edges():
    assert effective_size(np.full(7, 3.0)) == 7.0
    assert effective_size(np.array([1.0, 2.0])) == 2.0
    assert effective_size(np.array([1.0, -1.0] * 50)) <= 100.0


@pytest.mark.parametrize("constant", [0.001, 0.1, 0.2])
def test_the_deviation_of_a_ratio_is_honest(constant):
    """Over many windows error / deviation has the scatter of a unit normal."""
    rng = np.random.default_rng(2)
    scores, naive = [], []
    for _ in range(600):
        output = 300.0 * (1.0 + correlated(rng, 500, 0.01, constant))
        engine = 400.0 * (1.0 + correlated(rng, 500, 0.01, constant))
        value, std, _ = ratio_of_means(output, engine)
        scores.append((value - 0.75) / std)
        naive.append((value - 0.75) / (np.std(output / engine) / math.sqrt(500)))
    assert 0.85 < np.std(scores) < 1.2
    if constant >= 0.1:
        assert np.std(naive) > 2.5  # what leaving the correlation out would claim


def test_what_moves_both_powers_alike_is_no_scatter():
    engine = 400.0 * (1.0 + correlated(np.random.default_rng(3), 500, 0.05, 0.1))
    assert ratio_of_means(0.75 * engine, engine)[1] < 1e-12


def test_no_power_has_no_ratio():
    assert math.isnan(ratio_of_means(np.ones(4), np.array([1.0, -1.0, 1.0, -1.0]))[0])
