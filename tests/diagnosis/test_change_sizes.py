# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The size of a change over all sets that hold it, and the p-value of several channels."""

from types import SimpleNamespace

import numpy as np
import pytest

from hmcvt_core.benches.baseline.control import _of_any
from hmcvt_core.benches.baseline.sizes import posterior_size
from hmcvt_core.physics.effects.hydraulic import OrificeLeakage
from hmcvt_core.physics.effects.wear import LaminarLeakage

LEAKAGE = LaminarLeakage.name


def explanation(effects, sizes, covariance, form_error=""):
    """Return a stand-in for an explanation with one base parameter."""
    hypothesis = SimpleNamespace(
        base_count=1, size_indices=np.arange(1, 1 + len(sizes))
    )
    fit = SimpleNamespace(
        effects=effects, hypothesis=hypothesis, theta=np.array([0.3, *sizes])
    )
    whole = np.eye(1 + len(sizes))
    whole[1:, 1:] = covariance
    return SimpleNamespace(fit=fit, parameter_covariance=whole, form_error=form_error)


def diagnosis(sets):
    return SimpleNamespace(posterior=SimpleNamespace(sets=sets))


def test_a_correction_of_the_form_belongs_to_the_loss():
    effects = (LaminarLeakage(), OrificeLeakage())
    # Without the correction the leak is larger by what the two trade.
    bent = explanation(
        effects, [2.6, 0.5], [[0.04, -0.03], [-0.03, 0.05]], OrificeLeakage.name
    )
    size = posterior_size(diagnosis({(LEAKAGE,): (bent, 1.0)}), LEAKAGE)
    assert size.value == pytest.approx(2.6 + 0.03 / 0.05 * 0.5)
    assert size.standard_error == pytest.approx(0.2)


def test_a_further_cause_is_no_correction():
    effects = (LaminarLeakage(), OrificeLeakage())
    pair = explanation(effects, [2.6, 0.5], [[0.04, -0.03], [-0.03, 0.05]])
    size = posterior_size(diagnosis({(LEAKAGE, "o"): (pair, 1.0)}), LEAKAGE)
    assert size.value == pytest.approx(2.6)


def test_sets_that_disagree_widen_the_interval():
    alone = explanation((LaminarLeakage(),), [3.0], [[0.01]])
    other = explanation((LaminarLeakage(),), [2.0], [[0.01]])
    without = explanation((OrificeLeakage(),), [9.0], [[0.01]])
    sets = {
        (LEAKAGE,): (alone, 0.6),
        (LEAKAGE, "churning"): (other, 0.2),
        (OrificeLeakage.name,): (without, 0.2),
    }
    size = posterior_size(diagnosis(sets), LEAKAGE)
    assert size.value == pytest.approx(0.75 * 3.0 + 0.25 * 2.0)
    between = 0.75 * 0.25**2 + 0.25 * 0.75**2
    assert size.standard_error == pytest.approx(np.sqrt(0.01 + between))


def test_no_size_of_an_effect_that_no_set_holds():
    alone = explanation((LaminarLeakage(),), [3.0], [[0.01]])
    assert posterior_size(diagnosis({(LEAKAGE,): (alone, 1.0)}), "churning") is None


@pytest.mark.parametrize(
    ("smallest", "count", "any_channel"),
    [(0.0, 3, 0.0), (0.01, 3, 0.029701), (0.02, 1, 0.02), (1.0, 3, 1.0)],
)
def test_the_smallest_of_several_p_values_counts_for_less(smallest, count, any_channel):
    assert _of_any(smallest, count) == pytest.approx(any_channel, abs=1e-9)
