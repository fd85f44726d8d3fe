# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt watch`: the false alarms that are stated, and when and how large a gap has opened."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from studies.watch import NOISE, OPENS, SIZES, stream, watched, well_known

MODEL = well_known()


@pytest.mark.parametrize(
    ("units", "alarms"), [(60, 1), pytest.param(200, 2, marks=pytest.mark.long)]
)
def test_false_alarms_are_at_most_those_stated(units, alarms):
    """Units that differ from their model as it says; also where noise is understated."""
    streams = [stream(MODEL, seed, samples=120) for seed in range(units)]
    assert sum(watched(MODEL, samples).open for samples in streams) <= alarms
    noisy = [
        stream(MODEL, seed, noise=1.25 * NOISE, samples=120)
        for seed in range(units // 5)
    ]
    assert sum(watched(MODEL, samples).open for samples in noisy) <= 1


@pytest.mark.parametrize("gap", ["charge_pump", "churning", "step"])
def test_opening_is_noticed_sized_and_dated(gap):
    delays, held = [], 0
    for size in SIZES[1:]:
        found = [watched(MODEL, stream(MODEL, seed, gap, size)) for seed in range(5)]
        assert all(each.open and each.noticed > OPENS for each in found), size
        delays.append(np.median([each.noticed - OPENS for each in found]))
        assert np.median([each.size for each in found]) == pytest.approx(
            -size, rel=0.15
        )
        held += sum(each.interval[0] <= -size <= each.interval[1] for each in found)
        # An interval holds where it opened; a large gap is dated to two samples.
        dated = sum(
            each.since_interval[0] <= OPENS + 1 <= each.since_interval[1]
            for each in found
        )
        assert dated >= 4
    assert delays == sorted(delays, reverse=True) and delays[0] < 50 and delays[-1] < 7
    assert held >= 13  # of 20


def test_single_bad_samples_open_nothing():
    samples = stream(MODEL, 3)
    efficiency = samples.efficiency.copy()
    efficiency[[0, 60, 200]] -= 0.3
    assert not watched(MODEL, replace(samples, efficiency=efficiency)).open


def test_model_without_errors_is_allowed_more():
    blank = replace(MODEL, standard_errors={}, correlation=None)
    low = replace(stream(MODEL, 0), efficiency=stream(MODEL, 0).efficiency - 0.01)
    assert watched(MODEL, low).open and not watched(blank, low).open


def test_order_of_stamps_and_parts():
    samples = replace(stream(MODEL, 1, "step", 0.02), stamp=10.0 + np.arange(300.0))
    found = hmcvt.watch(MODEL, samples, noise=NOISE)
    assert (
        hmcvt.watch(MODEL, samples.select(np.arange(300)[::-1]), noise=NOISE) == found
    )
    assert abs(found.since - OPENS - 1) <= 2 and found.since_stamp == 9.0 + found.since
    parts = hmcvt.Watch(MODEL, NOISE)
    for i in range(0, 300, 7):
        parts.take(samples.select(np.arange(i, min(i + 7, 300))))
    assert parts.result == found


def test_samples_without_an_answer():
    samples = stream(MODEL, 2, samples=30)
    load = samples.load_torque.copy()
    stroke, speed = samples.displacement_ratio.copy(), samples.engine_speed.copy()
    load[5], stroke[5], speed[5] = 5000.0, -1.0, 20.0
    found = watched(
        MODEL,
        replace(
            samples, load_torque=load, displacement_ratio=stroke, engine_speed=speed
        ),
    )
    assert (found.samples, found.without_answer, found.open) == (30, 1, False)


def test_a_long_stream_takes_no_more_memory():
    running = hmcvt.Watch(MODEL, NOISE)
    part = stream(MODEL, 0, samples=500)
    for _ in range(9):
        running.take(part)
    size = len(pickle.dumps(running))
    for _ in range(3):
        running.take(part)
    assert len(pickle.dumps(running)) < 1.05 * size
    assert running.result.samples == 6000
