# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The study of how much each constant of the diagnosis matters."""

import pytest

from hmcvt_core.diagnosis import settings
from hmcvt_core.diagnosis.selection import explanation
from hmcvt_core.errors import InputError
from studies.blind.bench.properties import Bench
from studies.blind.bench.study import cases
from studies.blind.sensitivity import changed, numeric_constants, scaled, trials


def test_constant_is_changed_where_it_is_used_and_comes_back():
    before = settings.SIZE_SPREADS
    with changed("SIZE_SPREADS", 2.0):
        assert list(explanation.SIZE_SPREADS) == [2.0 * value for value in before]
    assert explanation.SIZE_SPREADS is settings.SIZE_SPREADS is before


def test_counts_stay_whole_and_above_zero():
    assert scaled(1, 0.5) == 1
    assert scaled(4, 2.0) == 8
    assert scaled((0.5, 3), 2.0) == (1.0, 6)


def test_every_campaign_comes_with_every_change_once():
    todo = cases(3, 6000, Bench())
    every = trials(["FORM_ALLOWANCE"], todo)
    assert len({trial.key for trial in every}) == len(every) == 9
    assert "FORM_ALLOWANCE x 0.5" in {trial.name for trial in every}


def test_only_numbers_can_be_halved():
    assert "PRIOR_OF_SET_SIZE" not in numeric_constants()
    with pytest.raises(InputError, match="PRIOR_OF_SET_SIZE"):
        trials(["PRIOR_OF_SET_SIZE"], cases(1, 6000, Bench()))
