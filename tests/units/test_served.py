# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The saved model of a unit, and sets that no verdict names."""

import numpy as np
import pytest

from hmcvt_core.benches.unit import diagnose_unit
from hmcvt_core.benches.unit.samples import UnitSamples
from hmcvt_core.benches.unit.served import paper_terms, served_unit
from hmcvt_core.benches.unit.system import HydrostaticUnit

from .bench import CM3, DAMPING, LEAKAGE, TURN, grid


def pump(seed, squeezed=0.0, bump=0.0):
    """Tests of a pump; `squeezed` in 1/GPa, `bump` [m3/s] around the middle pressure."""
    speed, pressure = grid(9)
    w, p = speed * TURN / 60.0, pressure * 1e5
    size = CM3 * 1e-6 / TURN
    rng = np.random.default_rng(seed)
    flow = LEAKAGE * p + squeezed * 1e-9 * p * size * w
    flow = flow + bump * np.exp(-(((p - 2.2e7) / 8e6) ** 2)) * w / w.max()
    torque = DAMPING * w + 0.01 * size * p
    flow = flow + 0.002 * size * w * rng.standard_normal(len(w))
    torque = torque + 0.002 * size * p * rng.standard_normal(len(w))
    ones = np.ones(len(w))
    return UnitSamples("pump", size, ones, w, p, flow, torque, noise=0.002)


@pytest.fixture(scope="module")
def bumpy():
    return diagnose_unit(*pump(1, bump=4e-5).divided("pressure", 0.8), deals=False)


def test_an_unlisted_loss_is_handed_over_as_it_is(bumpy):
    row = bumpy.rmse["flow"]
    assert row["with_effects"] < 0.5 * row["base"]
    fresh = pump(2, bump=4e-5)
    inside = fresh.select(fresh.pressure < 0.75 * fresh.pressure.max())
    served = bumpy.served.rmse(inside)[0]
    assert served < 0.6 * bumpy.paper.rmse(inside)[0]


def test_errors_at_left_out_samples_cover_fresh_ones(bumpy):
    fresh = pump(3, bump=4e-5)
    inside = fresh.select(fresh.pressure < 0.75 * fresh.pressure.max())
    deviation = bumpy.served.deviation(inside)
    predicted = bumpy.served.predict(inside)
    for channel in ("flow_loss", "torque_loss"):
        error = np.abs(getattr(inside, channel) - predicted[channel])
        assert 0.8 < np.mean(error < 1.96 * deviation[channel]) <= 1.0


def test_the_terms_of_the_paper_are_kept_where_nothing_improves_on_them():
    samples = pump(5)
    system = HydrostaticUnit(samples)
    served = served_unit(system, samples, ())
    bands = {(band.band, band.side) for band in served.bands}
    sides = [(axis, side) for axis in ("pressure", "speed") for side in ("high", "low")]
    assert bands == {("inside", ""), *sides}
    fresh = pump(6)
    expected = paper_terms(system, samples).predict(fresh)
    for channel, predicted in served.predict(fresh).items():
        assert predicted == pytest.approx(expected[channel], rel=1e-9)


def test_the_deviation_grows_below_the_tests_too():
    samples = pump(1, bump=4e-5)
    low = samples.speed < 0.4 * samples.speed.max()
    served = served_unit(
        HydrostaticUnit(samples), samples.select(np.flatnonzero(~low)), ()
    )
    slow = samples.select(np.flatnonzero(low))
    deviation = served.deviation(slow)["flow_loss"]
    slowest = slow.speed == slow.speed.min()
    assert np.mean(deviation[slowest]) > 1.2 * np.mean(deviation[~slowest])


def test_weights_are_in_the_answer(bumpy):
    rows = bumpy.to_dict()["served"]
    assert rows[0]["band"] == "inside"
    for row in rows:
        for weights in row["weights"].values():
            assert sum(weights.values()) == pytest.approx(1.0)


@pytest.mark.long
def test_a_compressibility_beyond_physics_is_not_named():
    refused = diagnose_unit(pump(4, squeezed=5.0), deals=False).diagnosis
    assert refused.verdict == "unexplained" and refused.unlisted > 0.9
    assert any("at the bound of its size" in note for note in refused.notes)
    named = diagnose_unit(pump(4, squeezed=1.5), deals=False).diagnosis
    assert "compressibility" in named.sets[0].effects
