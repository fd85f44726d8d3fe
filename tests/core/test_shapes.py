# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Every shape of every effect changes some reading, and the priors of a diagnosis sum to 1."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.diagnosis import settings
from hmcvt_core.physics.effects import library
from hmcvt_core.transmission.ranges import OperatingPoints

SMALLEST_CHANGE = 1e-7
"""Relative change of a reading that counts: above the tolerance of the solver."""
LAYOUTS = ("hm4", "tractor", "output_coupled")


@pytest.fixture(scope="module")
def models():
    found = []
    for name in LAYOUTS:
        model = hmcvt.load_model(hmcvt.data_path(f"params/{name}.yaml"))
        found += list(model.stages.values()) if len(model.stages) > 1 else [model]
    return found


def shapes():
    for kind in library():
        for item in kind().parameters():
            if not item.is_size and item.high > item.low:
                yield pytest.param(
                    kind, item, id=f"{kind.name}-{kind.form}-{item.name}"
                )


def readings(model, effect):
    grid = itertools.product(
        np.linspace(-0.9, 0.9, 7),
        (75.0, 140.0, 225.0),
        (-150.0, 200.0),
        (40.0, 50.0, 100.0),
    )
    stroke, speed, load, oil = map(np.array, zip(*grid, strict=True))
    read = replace(model, effects=(effect,)).readings_at(
        OperatingPoints(stroke, speed, load, oil)
    )
    return np.stack(list(read.values()))


def sized(kind, item, other):
    """Return an effect of some size, with its further shapes at one end of their ranges."""
    values = {}
    for entry in kind().parameters():
        if entry.is_size:
            values[entry.name] = 0.5 * entry.typical + 0.5 * entry.high
        elif entry.name != item.name:
            values[entry.name] = entry.grid[other]
    return replace(kind(), **values)


@pytest.mark.parametrize(("kind", "item"), list(shapes()))
def test_every_shape_changes_a_reading(models, kind, item):
    for model, other in itertools.product(models, (0, -1)):
        effect = sized(kind, item, other)
        low, high = (
            readings(model, replace(effect, **{item.name: value}))
            for value in (item.low, item.high)
        )
        with np.errstate(invalid="ignore"):
            change = np.abs(high - low) / np.abs(low)
        if np.nanmax(change, initial=0.0) > SMALLEST_CHANGE:
            return
    pytest.fail(f"{item.name} changes no reading of {', '.join(LAYOUTS)}")


def test_priors_given_a_gap_sum_to_one():
    of_sets = sum(settings.PRIOR_OF_SET_SIZE.values())
    total = of_sets + settings.PRIOR_BASE_DISCREPANCY + settings.PRIOR_UNLISTED
    assert total == pytest.approx(1.0)
