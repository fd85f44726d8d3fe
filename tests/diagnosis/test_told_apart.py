# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What is made of the probabilities of sets: who is told from whom."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import Transmission, observe
from hmcvt_core.diagnosis.design import next_test as advice
from hmcvt_core.diagnosis.fitting.hypothesis import Hypothesis
from hmcvt_core.diagnosis.fitting.refit import refit
from hmcvt_core.diagnosis.pipeline import _twins
from hmcvt_core.diagnosis.selection.explanation import explain, smooth_discrepancies
from hmcvt_core.diagnosis.selection.posterior import Posterior
from hmcvt_core.diagnosis.selection.prediction import Prediction
from hmcvt_core.physics.effects.mechanical import ChargePump

from .campaigns import BASE, NOISE, campaign, with_column


def _explained(*sets):
    """A ranking of sets by their probabilities; a star says that a loss stands beside one."""
    rivals = [
        (
            SimpleNamespace(
                names=tuple(text.rstrip("*").split("+")),
                is_base=False,
                is_listed_set="*" not in text,
                explained_fraction=lambda bare, text=text: 0.5 if "*" in text else 1.0,
            ),
            p,
        )
        for text, p in sets
    ]
    return Posterior(tuple(rivals), base_only=SimpleNamespace(), no_gap=0.0)


@pytest.mark.parametrize(
    ("sets", "name", "others"),
    [
        ([("a", 0.45), ("b", 0.4), ("c", 0.1)], "a", ("b",)),
        (
            [("a", 0.45), ("b", 0.4), ("c", 0.1)],
            "c",
            ("a", "b"),
        ),  # outside: what it is taken for
        ([("a", 0.8), ("b", 0.2)], "a", ()),  # 80 % is enough
        ([("a", 0.79), ("b", 0.15), ("c", 0.06)], "a", ("b",)),
        ([("a+b", 0.5), ("c", 0.45), ("d", 0.05)], "c", ("a",)),  # b would add nothing
        (
            [("a+b", 0.6), ("b+c", 0.3), ("b", 0.1)],
            "a",
            ("c",),
        ),  # b alone is no alternative to a
    ],
)
def test_the_company_of_a_cause_is_the_smallest_set_that_holds_it(sets, name, others):
    assert _twins(_explained(*sets), name) == others


def test_a_set_is_told_from_the_loss_that_stands_beside_it():
    labels = advice._labels(_explained(("a*", 0.7), ("a", 0.3)))
    assert labels[("a",)][0].is_listed_set and not labels[()][0].is_listed_set
    assert labels[("a",)][1] == pytest.approx(0.65)


@pytest.mark.parametrize("off", [0.1, 0.3])
def test_no_gap_is_foretold_by_what_is_likelier_an_exact_base_or_one_a_little_off(off):
    loose = SimpleNamespace(
        names=(), is_base=True, is_listed_set=False, explained_fraction=lambda bare: 0.0
    )
    ranking = replace(_explained(("a", 1.0 - off)), no_gap=0.2)
    ranking = replace(ranking, entries=(*ranking.entries, (loose, off)))
    told = advice._labels(ranking)[None]
    assert told == (
        loose if off > 0.25 else ranking.base_only,
        pytest.approx(0.2 + 0.8 * off),
    )


@pytest.mark.parametrize(
    ("names", "p", "stuck"),
    [
        ([("a",), ("b",), ("far",)], (0.4, 0.35, 0.25), {0: 1, 1: 0}),
        (
            [("a",), ("b",), ("far",)],
            (0.7, 0.03, 0.27),
            {1: 0},
        ),  # 0.96 of the two is enough
        ([("a",), ("a", "b"), ("far",)], (0.4, 0.35, 0.25), {}),  # the larger gives way
        (
            [("a",), (), ("far",)],
            (0.4, 0.35, 0.25),
            {},
        ),  # and so does what nobody listed
    ],
)
def test_which_sets_no_test_will_settle(names, p, stuck):
    rivals = [
        Prediction(
            np.full((1, 4), 9.0 * (name == ("far",))), np.zeros((1, 4, 1)), np.eye(1)
        )
        for name in names
    ]
    assert advice._untold(rivals, names, np.array(p)) == stuck


def test_how_fine_the_tests_are_laid_out_does_not_decide_what_a_hundred_of_them_tell():
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


def test_what_is_foretold_of_the_campaign_is_what_was_weighed_there():
    observed = observe(campaign([ChargePump(6.0)], seed=3), NOISE)
    rival, _ = smooth_discrepancies(
        explain(refit(Hypothesis(Transmission(BASE), (ChargePump(),)), observed))
    )
    elsewhere = observed.select(np.arange(len(observed)))
    for with_allowances, model in ((False, rival.plain_model), (True, rival.model)):
        told = rival.prediction_at(elsewhere, with_allowances)
        np.testing.assert_allclose(told.mean, -model.residual(), atol=1e-6)
        np.testing.assert_allclose(told.columns, model.columns, atol=1e-6)


def test_a_slipping_clutch_is_no_leakage_and_loses_efficiency_with_the_speed():
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
