# SPDX-License-Identifier: Apache-2.0
"""Which samples repeat an operating point."""

import numpy as np
import pytest

from hmcvt_core.diagnosis.observations import Observations
from hmcvt_core.diagnosis.replicates import replicate_groups

from .campaigns import campaign, with_column


def _jittered(seed=0, points=10, times=4):
    """Points set again and again, as closely as a bench sets them."""
    rng = np.random.default_rng(seed)
    repeated = campaign(seed=seed, n=points, noise=0.0).select(np.repeat(np.arange(points), times))
    n = len(repeated)
    return with_column(
        repeated, engine_speed=repeated.engine_speed + 0.05 * rng.standard_normal(n),
        load_torque=repeated.load_torque + 0.05 * rng.standard_normal(n),
        efficiency=repeated.efficiency + 0.004 * rng.standard_normal(n))


@pytest.mark.parametrize("seed", range(4))
def test_points_set_again_by_a_real_bench_are_repeats(seed):
    samples = _jittered(seed)
    np.testing.assert_array_equal(
        [len(set(part)) for part in replicate_groups(samples).reshape(10, 4)], 1)
    observed = Observations.of(samples)
    assert observed.noise_source == "repeated points"
    assert observed.scale[0, 0] == pytest.approx(0.004, rel=0.35)


def test_points_of_a_random_plan_are_distinct():
    assert len(np.unique(replicate_groups(campaign(seed=1, n=96)))) >= 95


def test_a_slow_sweep_is_no_single_point():
    samples = campaign(seed=1, n=2000)
    order = np.argsort(samples.engine_speed)
    still = {name: np.full(2000, value) for name, value in (
        ("displacement_ratio", 0.1), ("load_torque", 200.0))}
    sweep = with_column(samples, engine_speed=samples.engine_speed[order], **still)
    groups = replicate_groups(sweep)
    width = max(float(np.ptp(sweep.engine_speed[groups == i])) for i in np.unique(groups))
    assert width <= 2.0 * 0.002 * float(np.ptp(sweep.engine_speed)) * 1.001


def test_the_order_of_the_rows_does_not_matter():
    samples = _jittered(1)
    order = np.random.default_rng(2).permutation(len(samples))
    np.testing.assert_array_equal(replicate_groups(samples)[order],
                                  replicate_groups(samples.select(order)))
