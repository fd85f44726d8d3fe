# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which effects and sets the data, or further tests, cannot distinguish."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import Transmission, observe
from hmcvt_core.diagnosis.design.advice import NO_GAP, UNLISTED, Kind, Label
from hmcvt_core.diagnosis.design.next_test import candidates_of, indistinguishable
from hmcvt_core.diagnosis.fitting.hypothesis import Hypothesis
from hmcvt_core.diagnosis.fitting.refit import refit
from hmcvt_core.diagnosis.results.summary import indistinguishable_from
from hmcvt_core.diagnosis.selection.explanation import explain, smooth_discrepancies
from hmcvt_core.diagnosis.selection.posterior import Posterior
from hmcvt_core.diagnosis.selection.prediction import Prediction
from hmcvt_core.physics.effects.mechanical import ChargePump

from .campaigns import BASE, NOISE, campaign, with_column


def _posterior(*sets):
    """A posterior over sets by their probabilities; a star adds an unlisted loss to one."""
    entries = []
    for text, probability in sets:
        starred = "*" in text
        explanation = SimpleNamespace(
            names=tuple(text.rstrip("*").split("+")),
            is_base_discrepancy=False,
            is_listed_set=not starred,
            absent=(),
            has_excess_noise=False,
            fit=SimpleNamespace(hypothesis=SimpleNamespace(reversed_sign=False)),
            explained_fraction=lambda bare, starred=starred: 0.5 if starred else 1.0,
        )
        entries.append((explanation, probability))
    return Posterior(tuple(entries), base_only=SimpleNamespace(), no_gap=0.0)


@pytest.mark.parametrize(
    ("sets", "name", "others"),
    [
        ([("a", 0.45), ("b", 0.4), ("c", 0.1)], "a", ("b",)),
        # Outside the credible set: what the effect is mistaken for.
        ([("a", 0.45), ("b", 0.4), ("c", 0.1)], "c", ("a", "b")),
        ([("a", 0.8), ("b", 0.2)], "a", ()),  # 80 % is enough
        ([("a", 0.79), ("b", 0.15), ("c", 0.06)], "a", ("b",)),
        ([("a+b", 0.5), ("c", 0.45), ("d", 0.05)], "c", ("a",)),  # b would add nothing
        # b alone is no alternative to a.
        ([("a+b", 0.6), ("b+c", 0.3), ("b", 0.1)], "a", ("c",)),
    ],
)
def test_smallest_credible_set(sets, name, others):
    assert indistinguishable_from(_posterior(*sets), name) == others


def test_set_is_distinguished_from_its_unlisted_loss():
    candidates = {
        item.label: item for item in candidates_of(_posterior(("a*", 0.7), ("a", 0.3)))
    }
    listed = candidates[Label(Kind.LISTED, ("a",))]
    assert listed.explanation.is_listed_set
    assert not candidates[UNLISTED].explanation.is_listed_set
    assert listed.probability == pytest.approx(0.65)


@pytest.mark.parametrize("off", [0.1, 0.3])
def test_no_gap_is_the_likelier_of_exact_base_and_one_a_little_off(off):
    loose = SimpleNamespace(
        names=(),
        is_base_discrepancy=True,
        is_listed_set=False,
        explained_fraction=lambda bare: 0.0,
    )
    posterior = replace(_posterior(("a", 1.0 - off)), no_gap=0.2)
    posterior = replace(posterior, entries=(*posterior.entries, (loose, off)))
    no_gap = candidates_of(posterior)[-1]
    assert no_gap.label == NO_GAP
    assert no_gap.explanation is (loose if off > 0.25 else posterior.base_only)
    assert no_gap.probability == pytest.approx(0.2 + 0.8 * off)


@pytest.mark.parametrize(
    ("names", "p", "confused"),
    [
        ([("a",), ("b",), ("far",)], (0.4, 0.35, 0.25), {0: 1, 1: 0}),
        # 0.96 of the two is enough.
        ([("a",), ("b",), ("far",)], (0.7, 0.03, 0.27), {1: 0}),
        ([("a",), ("a", "b"), ("far",)], (0.4, 0.35, 0.25), {}),  # nested sets
        ([("a",), (), ("far",)], (0.4, 0.35, 0.25), {}),  # an unlisted loss
    ],
)
def test_sets_that_no_test_settles(names, p, confused):
    predictions = [
        Prediction(
            np.full((1, 4), 9.0 * (name == ("far",))), np.zeros((1, 4, 1)), np.eye(1)
        )
        for name in names
    ]
    labels = [Label(Kind.LISTED, name) if name else UNLISTED for name in names]
    assert indistinguishable(predictions, labels, np.array(p)) == confused


def test_distance_does_not_depend_on_the_grid_of_tests():
    one, other = (
        Prediction(np.full((1, 4), mean), np.ones((1, 4, 1)), np.eye(1))
        for mean in (0.0, 1.0)
    )
    finer = one._replace(mean=np.zeros((1, 8)), columns=np.ones((1, 8, 1)))
    told = one.squared_distance(other, 100.0)
    assert told == pytest.approx(
        100.0 / 101.0
    )  # 100 deviations, of which a mean is free
    assert finer.squared_distance(
        other._replace(mean=np.ones((1, 8))), 100.0
    ) == pytest.approx(told)
    wide = one._replace(
        columns=np.array([[[0.0, 1e3]] * 4]), covariance=np.diag([1e9, 1e-6])
    )
    assert wide.squared_distance(other, 100.0) == pytest.approx(
        told
    )  # in whatever unit


def test_prediction_of_the_campaign_is_the_fit():
    observed = observe(campaign([ChargePump(6.0)], seed=3), NOISE)
    rival, _ = smooth_discrepancies(
        explain(refit(Hypothesis(Transmission(BASE), (ChargePump(),)), observed))
    )
    elsewhere = observed.select(np.arange(len(observed)))
    for with_allowances, model in ((False, rival.plain_model), (True, rival.model)):
        told = rival.prediction_at(elsewhere, with_allowances)
        np.testing.assert_allclose(told.mean, -model.residual(), atol=1e-6)
        np.testing.assert_allclose(told.columns, model.columns, atol=1e-6)


@pytest.mark.long
def test_slipping_clutch_is_no_leakage():
    quiet = campaign(seed=3, n=96)
    passed = 1.0 - 1e-4 * np.maximum(quiet.load_torque - 350.0, 0.0)
    found = hmcvt.diagnose(
        BASE,
        with_column(
            quiet,
            output_speed=passed * quiet.output_speed,
            efficiency=passed * quiet.efficiency,
        ),
        noise=NOISE,
    )
    place = quiet.displacement_ratio, quiet.engine_speed, quiet.load_torque
    left = passed * BASE.efficiency(*place) - found.base.efficiency(*place)
    assert found.verdict == "unexplained"
    assert np.corrcoef(found.gap_at(*place)[0], left)[0, 1] > 0.9
