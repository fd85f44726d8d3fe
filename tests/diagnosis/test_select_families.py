# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The selection of families against all subsets of few."""

from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np
import pytest

from hmcvt_core.diagnosis.fitting.evidence import fitted_model, linear_models
from hmcvt_core.diagnosis.selection.discrepancy import Columns
from hmcvt_core.diagnosis.selection.families import (
    _AMPLITUDES,
    _Gains,
    log_prior_of_subset,
    select_families,
)
from hmcvt_core.diagnosis.settings import MAX_FAMILIES

FAMILIES = 4
OPTIONAL = np.arange(FAMILIES)


class _Readings(NamedTuple):
    """What the evidence asks of the readings."""

    count: int
    prior_dof: np.ndarray

    def __len__(self):
        return self.count


READINGS = _Readings(60, np.array([1e8, 1e8]))
"""Their noise is as stated."""

DOUBTED = _Readings(60, np.array([8.0, 8.0]))
"""Their noise may be another than stated, so that it may take up the gap."""


def _columns(seed):
    """One coefficient of the model, and families of two or three columns."""
    rng = np.random.default_rng(seed)
    group = np.array([-1, 0, 0, 1, 1, 1, 2, 2, 3, 3, 3])
    columns = rng.standard_normal((2, 60, len(group)))
    return Columns(columns, np.exp(rng.uniform(-1.0, 1.0, len(group))), group)


def _readings_of(columns, families, seed, size=1.0):
    """Readings that some families make."""
    rng = np.random.default_rng(seed)
    kept = columns.of_families(families)
    coefficients = size * kept.spread * rng.standard_normal(len(kept.spread))
    return kept.columns @ coefficients + rng.standard_normal((2, 60))


def _fitted(columns, target, readings=READINGS):
    return fitted_model(
        readings, columns.columns, target, columns.spread, columns.group
    )


@pytest.mark.parametrize("least", [0, 1])
@pytest.mark.parametrize("families", [1, 5, 40])
def test_priors_of_all_subsets_sum_to_one(families, least):
    priors = np.exp(log_prior_of_subset(families, least))
    subsets = [comb(families, size) for size in range(families + 1)]
    assert priors @ subsets == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(3))
def test_gain_of_a_family_is_that_of_the_model_with_it(seed):
    columns = _columns(seed)
    target = _readings_of(columns, [0, 2], seed)
    without = _fitted(columns.of_families([0]), target)
    is_present = np.isin(columns.group, [-1, 0])
    absent = np.array([1, 2, 3])
    gains = _Gains(columns, target, OPTIONAL).of(absent, without, is_present)

    held = columns.spread.copy()
    held[is_present] = without.spread
    (at_start,) = linear_models(
        READINGS,
        columns.columns[..., is_present],
        target,
        held[is_present][None],
        np.full(np.count_nonzero(is_present), np.nan),
    )
    for gain, family in zip(gains.T, absent, strict=True):
        is_extended = is_present | (columns.group == family)
        spreads = []
        for amplitude in _AMPLITUDES:
            of_family = np.where(columns.group == family, amplitude * held, held)
            spreads.append(of_family[is_extended])
        signs = np.full(np.count_nonzero(is_extended), np.nan)
        extended = linear_models(
            READINGS,
            columns.columns[..., is_extended],
            target,
            np.array(spreads),
            signs,
        )
        expected = [model.log_evidence - at_start.log_evidence for model in extended]
        assert gain == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("present", [(), (1,), (0, 3), (0, 1, 2, 3)])
def test_families_that_made_the_readings_are_selected(present):
    columns = _columns(7)
    target = _readings_of(columns, present, seed=11, size=2.0)
    assert select_families(READINGS, columns, target, OPTIONAL).families == present


def test_at_least_one_is_selected_where_one_must_be():
    columns = _columns(7)
    target = _readings_of(columns, (), seed=11)
    selection = select_families(READINGS, columns, target, OPTIONAL, least=1)
    assert len(selection.families) == 1


@pytest.mark.parametrize("present", [(), (1,), (0, 3)])
@pytest.mark.parametrize("least", [0, 1])
def test_evidence_is_nearly_that_over_all_subsets(present, least):
    columns = _columns(5)
    target = _readings_of(columns, present, seed=13)
    log_priors = log_prior_of_subset(FAMILIES, least)
    every = []
    for size in range(least, FAMILIES + 1):
        for subset in combinations(range(FAMILIES), size):
            model = _fitted(columns.of_families(subset), target)
            every.append(model.log_evidence + log_priors[size])
    selection = select_families(READINGS, columns, target, OPTIONAL, least)
    # Amplitudes of those only looked at are averaged over a few values.
    assert selection.log_evidence == pytest.approx(np.logaddexp.reduce(every), abs=0.3)


@pytest.mark.parametrize("size", [1.0, 5.0, 20.0])
@pytest.mark.parametrize("present", [(1,), (0, 3), (0, 1, 2, 3)])
def test_noise_does_not_take_up_what_a_family_explains(present, size):
    columns = _columns(5)
    target = _readings_of(columns, present, seed=13, size=size)
    selection = select_families(DOUBTED, columns, target, OPTIONAL)
    whole = _fitted(columns.of_families(present), target, DOUBTED)
    log_prior = log_prior_of_subset(FAMILIES)[len(present)]
    assert set(present) <= set(selection.families)
    assert selection.log_evidence > whole.log_evidence + log_prior - 0.5


def test_one_channel_and_one_family():
    columns = _columns(5).of_families([1])
    one = Columns(columns.columns[:1], columns.spread, columns.group)
    target = _readings_of(columns, [1], seed=13, size=3.0)[:1]
    readings = _Readings(60, np.array([8.0]))
    assert select_families(readings, one, target, np.array([1])).families == (1,)


def test_no_more_families_than_the_most_are_added():
    rng = np.random.default_rng(8)
    group = np.append(-1, np.arange(12))
    columns = Columns(rng.standard_normal((2, 60, 13)), np.ones(13), group)
    target = _readings_of(columns, range(12), seed=3, size=5.0)
    selection = select_families(DOUBTED, columns, target, np.arange(12))
    assert len(selection.families) == MAX_FAMILIES


def test_a_family_that_is_absent_costs_little():
    """Thirty columns too many cost tens of nats if present, and a few if they may be absent."""
    rng = np.random.default_rng(3)
    group = np.append(-1, np.repeat(np.arange(10), 3))
    columns = Columns(rng.standard_normal((2, 60, 31)), np.ones(31), group)
    target = _readings_of(columns, [], seed=17)
    alone = _fitted(columns.of_families([]), target).log_evidence
    of_all = _fitted(columns, target).log_evidence
    selection = select_families(READINGS, columns, target, np.arange(10))
    assert of_all < alone - 10.0
    assert selection.log_evidence > alone - 3.0
