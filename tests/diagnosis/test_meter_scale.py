# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Zeros of the torque meters as large as the sessions of a baseline show them."""

import numpy as np
import pytest

from hmcvt_core.benches.transmission.change import _zero_notes
from hmcvt_core.benches.transmission.meter_scale import with_scaled_zeros, zero_scales
from hmcvt_core.diagnosis.observations import Observations, SharedError
from hmcvt_core.diagnosis.results.outcome import SharedErrorEstimate

ENGINE = "zero of the engine meter"
OUTPUT = "zero of the output meter"


def estimates(name, values, error=0.1, session="day"):
    return [
        SharedErrorEstimate(
            name, f"{session}{i}" if session else "", v, error, 1.0, "N m"
        )
        for i, v in enumerate(values)
    ]


def test_zeros_beyond_the_class_widen_it():
    scales = zero_scales(estimates(ENGINE, [3.0, -3.0, 3.0]))
    assert scales[ENGINE] == pytest.approx(np.sqrt((2.0 + 27.03) / 5.0))


def test_zeros_within_the_class_never_narrow_it():
    assert zero_scales(estimates(ENGINE, [0.1, 0.0, -0.1])) == {ENGINE: 1.0}


def test_what_says_nothing_of_a_zero_is_left_aside():
    errors = [
        *estimates("half the drift of the engine meter", [9.0]),
        *estimates("zero of the stroke sensor", [9.0]),
        *estimates(ENGINE, [9.0], session=""),
    ]
    assert zero_scales(errors) == {}


def test_only_the_meter_that_moves_is_scaled():
    names = (SharedError(ENGINE, "1", 1.0, "N m"), SharedError(OUTPUT, "1", 4.0, "N m"))
    columns = np.ones((1, 3, 2))
    observed = Observations(
        axes=(),
        points={},
        channels=(),
        measured=np.ones((1, 3)),
        deviation=np.ones((1, 3)),
        prior_dof=np.ones(1),
        number=np.arange(3),
        samples=None,
        noise_source="",
        shared_errors=columns,
        shared_names=names,
    )
    scaled = with_scaled_zeros(observed, {ENGINE: 2.0})
    assert scaled.shared_errors[0, 0].tolist() == [2.0, 1.0]
    assert [error.deviation for error in scaled.shared_names] == [2.0, 4.0]


def test_the_note_names_the_meters_beyond_their_class_alone():
    (note,) = _zero_notes({ENGINE: 1.8, OUTPUT: 1.2})
    assert note == (
        "the zeros of the engine meter moved by 1.8 times their class between the sessions of "
        "the baseline; the comparison allows for as much"
    )
    (note,) = _zero_notes({ENGINE: 1.6, OUTPUT: 1.7})
    assert "engine meter or output meter moved by 1.7 times" in note
    assert "barely distinguish the two" in note
    assert _zero_notes({ENGINE: 1.0, OUTPUT: 1.2}) == []
