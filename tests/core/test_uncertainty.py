# SPDX-License-Identifier: Apache-2.0
"""Eqs (1)-(3) with the readings and results of section 2.2."""

import math

import pytest

from hmcvt_core import InputError
from hmcvt_core.transmission.uncertainty import (
    PAPER_EFFICIENCY_UNCERTAINTY,
    random_uncertainty,
    systematic_uncertainty,
    total_uncertainty,
)

# Section 2.2. The full scales are 5000 N m and 3000 r/min, the errors 10 N m and 1 r/min.
TORQUE_SCATTER = random_uncertainty(100.4720, 0.8889)
SPEED_SCATTER = random_uncertainty(78.6820, 0.5309)
TORQUE_METER = systematic_uncertainty(10.0 / 5000.0)
SPEED_METER = systematic_uncertainty(1.0 / 3000.0)


@pytest.mark.parametrize(("found", "percent", "digit"), [
    # The paper cuts off: 0.8847 -> 0.88, 0.6747 -> 0.67.
    (TORQUE_SCATTER, 0.88, 0.01),
    (SPEED_SCATTER, 0.67, 0.01),
    (TORQUE_METER, 0.12, 0.005),
    (SPEED_METER, 0.019, 0.0005),
    (total_uncertainty(TORQUE_SCATTER, SPEED_SCATTER, TORQUE_METER, SPEED_METER), 1.12, 0.005),
])
def test_numbers_of_the_paper(found, percent, digit):
    assert 100.0 * found == pytest.approx(percent, abs=digit)


def test_total_used_as_weight_is_the_papers():
    assert PAPER_EFFICIENCY_UNCERTAINTY == 0.0112


@pytest.mark.parametrize("bad", [(0.0, 1.0), (math.nan, 1.0), (1.0, math.inf)])
def test_no_mean_no_uncertainty(bad):
    with pytest.raises(InputError, match="finite numbers and a mean other than 0"):
        random_uncertainty(*bad)
