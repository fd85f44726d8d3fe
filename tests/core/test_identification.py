# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Identification: the paper's split, known truth from synthetic samples, what stays open."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

import hmcvt_core as hmcvt
from hmcvt_core.identification import Schedule
from hmcvt_core.identification.piecewise import hydraulic_roots
from hmcvt_core.identification.problem import Problem
from hmcvt_core.model.accuracy import determination_loss, relative_errors
from hmcvt_core.transmission.parameters import PARAMETER_NAMES

from .conftest import FIT

QUICK = Schedule(chains=4, moves=5)
TRUTH = hmcvt.HydraulicParameters(2e-11, 0.15, 0.1)
NOISE = 0.004


def synthetic(stage, n, seed, noise=NOISE):
    """Samples of a known truth over the working range, and their exact efficiency."""
    rng = np.random.default_rng(seed)
    stroke = rng.uniform(-1.0, 1.0, n)
    speed = rng.uniform(80.0, 230.0, n)
    torque = rng.uniform(80.0, 400.0, n)
    exact = hmcvt.EfficiencyModel(stage, TRUTH).efficiency(stroke, speed, torque)
    measured = exact + noise * rng.standard_normal(n)
    return hmcvt.BenchSamples(
        stroke, speed, torque, measured, efficiency_std=np.full(n, max(noise, 1e-6))
    )


@pytest.mark.parametrize(
    ("formulation", "fit", "prediction"),
    [
        # goal: at or below 2.05 % (fit) and 1.65 % (prediction); docs/theory.md found these.
        ("power_balance", 0.0202, 0.0160),
        # goal: at or below 1.35 % and 1.70 %; differential evolution found these
        # (docs/theory.md); the paper states 2.16 and 1.90.
        ("published", 0.0132, 0.0162),
    ],
)
def test_the_targets_are_met(
    fitted, fitted_published, table2, formulation, fit, prediction
):
    found = fitted if formulation == "power_balance" else fitted_published
    assert found.fit_error == pytest.approx(fit, abs=5e-5)
    assert found.prediction_error == pytest.approx(prediction, abs=5e-5)
    measured = table2.efficiency[FIT]
    predicted = found.model.efficiency(*table2.select(FIT).points)
    assert relative_errors(predicted, measured).mean() == pytest.approx(found.fit_error)
    assert found.residuals == pytest.approx(predicted - measured, rel=1e-9)


def test_objective_21_by_hand(fitted_published, table2):
    """Predicted against measured, over predicted against the mean."""
    measured = table2.select(FIT).efficiency
    predicted = measured + fitted_published.residuals
    loss = np.sum((predicted - measured) ** 2) / np.sum(
        (predicted - measured.mean()) ** 2
    )
    assert fitted_published.objective == pytest.approx(loss, rel=1e-9)
    assert determination_loss(predicted, measured) == pytest.approx(loss, rel=1e-9)


# Lowest weighted squares by least squares from 64 points (docs/studies/timings.md).
LOWEST = {"five": 3.9710167, "eight": 3.1234263, "simulated": 2.1298878}


def campaign(name, table2):
    if name == "simulated":
        return hmcvt.read_bench(hmcvt.data_path("data/simulated.csv"))
    return table2.select(FIT) if name == "five" else table2


@pytest.mark.parametrize("name", LOWEST)
def test_annealing_arrives_by_itself(table2, name):
    """Within 0.01 %, and least squares finishes it: every seed ends at the same parameters.

    100 of 100 seeds do (docs/studies/annealing.md); in one round, or with fewer chains, most do
    not.
    """
    found = [hmcvt.identify(campaign(name, table2), seed=seed) for seed in range(4)]
    assert max(fit.annealing_objective for fit in found) < 1.0001 * LOWEST[name]
    assert max(fit.evaluations for fit in found) < 14_000
    for fit in found:
        assert fit.objective == pytest.approx(LOWEST[name], rel=2e-8)
        assert (
            fit.annealing_objective
            == fit.history[-2]
            >= fit.history[-1]
            == fit.objective
        )
        np.testing.assert_allclose(
            fit.parameters.to_array(), found[0].parameters.to_array(), rtol=1e-4
        )


def test_published_misses_the_local_minimum(table2, fitted_published):
    """Of 1 - RSQ, which predicts test 3 as 63 %."""
    for fit in (
        fitted_published,
        hmcvt.identify(table2.select(FIT), formulation="published", seed=1),
    ):
        assert fit.objective == pytest.approx(0.018479745, rel=1e-7)
        assert fit.annealing_objective < 1.05 * fit.objective
        assert fit.model.efficiency(0.73, 78.54, 267.38) == pytest.approx(
            0.808, abs=0.02
        )


def test_many_candidates_are_predicted_as_one_by_one(hm4, table2):
    """However many rows at once, and in any shape."""
    problem = Problem(hmcvt.EfficiencyModel(hm4, TRUTH), table2)
    scaled = np.random.default_rng(0).uniform((-13, 0, 0), (-10, 1, 1.5), (3, 700, 3))
    found = problem.predict(scaled)
    assert found.shape == (3, 700, 8)
    for i, j in ((0, 0), (1, 350), (2, 699)):
        one = hmcvt.HydraulicParameters(10.0 ** scaled[i, j, 0], *scaled[i, j, 1:])
        np.testing.assert_allclose(
            found[i, j],
            replace(problem.model, parameters=one).efficiency(*table2.points),
            rtol=1e-12,
        )


@pytest.mark.parametrize("leakage", [1e-13, 1e-10])
def test_a_leakage_at_its_bound_is_found_there(hm4, leakage):
    """And nowhere beyond, where rounding of the logarithm might put it."""
    model = hmcvt.EfficiencyModel(hm4, hmcvt.HydraulicParameters(leakage, 0.1, 0.1))
    rng = np.random.default_rng(0)
    point = rng.uniform(-1, 1, 30), rng.uniform(90, 200, 30), rng.uniform(80, 250, 30)
    # Beyond the bound: a bench that loses less, or more, than any leakage allowed.
    told = model.efficiency(*point) * (1.005 if leakage < 1e-12 else 0.97)
    found = hmcvt.identify(hmcvt.BenchSamples(*point, told), schedule=QUICK)
    assert found.parameters.leakage == leakage
    side = "lower bound 1e-13" if leakage < 1e-12 else "upper bound 1e-10"
    assert any(side in sentence for sentence in found.warnings)


def roots_of_equation_18(displacement_ratio, efficiency, gear=0.98):
    """eta_H from eqs (8), (11), (12), (18) made one cubic, solved by the companion matrix.

    By hand: with q = x g^2 (x = eta_H), r = (1 + A) / i_HM and e = e_H < 0, (12) gives
    1 / eta_HM = (q (r - 1) + 1) / r, and (18) becomes
    g^2 [(1 - a_1) g^2 + a_1] r = efficiency (q (r - 1) + 1).
    """
    i2, i3, i4, i5, i6, i11, k = 0.969, 1.484, 0.678, 1.96, 0.982, 0.823, 2.56
    ratio = ((1 + k) * i4 * i5 + displacement_ratio * i2 * i3) / (
        k * i2 * i3 * i4 * i5 * i6 * i11
    )
    r, g2 = ratio * k / (1 + k), gear**2
    e = 1.0 - 1.0 / r
    inverse = np.poly1d([g2 * (r - 1.0) / r, 1.0 / r])
    below = (inverse - e) * np.poly1d(
        [1.0, 0.0]
    ) + e  # denominator of a_1: eta_2 eta_3 cancels g^2
    # a_1 = e / below; multiply (18) by it.
    cubic = ((below - e) * g2 + e) * g2 - efficiency * inverse * below
    return sorted(
        float(root.real)
        for root in cubic.roots
        if abs(root.imag) < 1e-12 and 0.0 < root.real < 1.0
    )


@pytest.mark.parametrize(
    ("test", "efficiency", "expected"),
    [
        # docs/theory.md, test 1.
        (1, 0.643, (0.163, 0.526)),
        # Confirmed with SymPy.
        (2, 0.698, (0.130, 0.508)),
        (5, 0.588, (0.040, 0.441)),
    ],
)
def test_both_roots_are_found_and_one_is_sound(hm4, table2, test, efficiency, expected):
    samples = table2.select([test - 1])
    assert samples.efficiency[0] == efficiency
    roots = hydraulic_roots(hm4, samples)[0]
    by_hand = roots_of_equation_18(samples.displacement_ratio[0], efficiency)
    assert by_hand == pytest.approx(expected, abs=6e-4)
    assert sorted(roots.consistent + roots.rejected) == pytest.approx(by_hand, abs=1e-9)
    # The lower one lies beyond the pole of (11), where a_1 > 1 contradicts e_H < 0.
    assert (len(roots.consistent), len(roots.rejected)) == (1, 1)
    assert roots.consistent[0] > roots.rejected[0]


def test_limits_of_the_search_are_no_interval(fitted):
    report = fitted.report()
    assert "(mean of residual^2 / noise^2; noise alone gives about 1)" in report
    (leakage,) = [line for line in report.splitlines() if "leakage   " in line]
    assert leakage.endswith("m3/(s Pa) (90 %: not determined)")
    (damping,) = [line for line in report.splitlines() if "pump_damping   " in line]
    assert "(90 %: below 0.25" in damping


def test_rejected_roots_are_reported(fitted_published):
    assert [len(entry.rejected) for entry in fitted_published.roots] == [1, 1, 0, 1, 0]
    assert (
        "3 samples have a second root for eta_H, beyond the pole"
        in fitted_published.report()
    )


@pytest.mark.parametrize("seed", range(3))
def test_truth_is_recovered_from_noisy_samples(hm4, seed):
    found = hmcvt.identify(
        synthetic(hm4, 60, seed), stage=hm4, schedule=QUICK, seed=seed
    )
    for name in PARAMETER_NAMES:
        miss = getattr(found.parameters, name) - getattr(TRUTH, name)
        assert abs(miss) < 3.0 * found.standard_errors[name], name
        assert found.standard_errors[name] < 0.25 * getattr(TRUTH, name), name
    assert found.warnings == ()


def test_standard_errors_equal_the_scatter_of_repeated_benches(hm4):
    """Monte Carlo: 100 noisy repetitions of the same 40 points, each fitted by SciPy."""
    base = synthetic(hm4, 40, 11, noise=0.0)
    exact, rng = base.efficiency, np.random.default_rng(5)
    points = (base.displacement_ratio, base.engine_speed, base.load_torque)

    def fit(measured):
        def residuals(x):
            found = hmcvt.HydraulicParameters(10.0 ** x[0], *np.abs(x[1:]))
            predicted = hmcvt.EfficiencyModel(hm4, found).efficiency(*points)
            return (predicted - measured) / NOISE

        return least_squares(
            residuals, (np.log10(2e-11), 0.15, 0.1), x_scale=(0.1, 0.1, 0.1)
        ).x

    fitted = np.array(
        [fit(exact + NOISE * rng.standard_normal(40)) for _ in range(100)]
    )
    scatter = fitted.std(axis=0) * [np.log(10.0) * 2e-11, 1.0, 1.0]
    noisy = replace(
        base,
        efficiency=exact + NOISE * rng.standard_normal(40),
        efficiency_std=np.full(40, NOISE),
    )
    stated = hmcvt.identify(noisy, stage=hm4, schedule=QUICK)
    # 100 repetitions know the scatter to 7 %, one bench its own noise to 12 %.
    np.testing.assert_allclose(list(stated.standard_errors.values()), scatter, rtol=0.3)
    np.testing.assert_allclose(stated.correlation, np.corrcoef(fitted.T), atol=0.2)


@pytest.mark.parametrize(
    ("sign", "missing", "present"),
    [(1.0, "negative", "positive"), (-1.0, "positive", "negative")],
)
def test_one_sign_of_stroke_only(hm4, sign, missing, present):
    samples = synthetic(hm4, 40, 2)
    half = samples.select(sign * samples.displacement_ratio > 0.1)
    found = hmcvt.identify(half, stage=hm4, schedule=QUICK)
    assert (
        f"no sample has a {missing} displacement ratio: the model is unchecked there"
        in found.warnings
    )
    assert not any(f"{present} displacement" in sentence for sentence in found.warnings)


def test_annealing_of_many_samples_looks_at_some_and_tells_of_all(hm4):
    samples = synthetic(hm4, 700, 4)
    asked = []
    found = hmcvt.identify(samples, stage=hm4, schedule=QUICK, progress=asked.append)
    assert found.objective == pytest.approx(
        np.mean((found.residuals / samples.efficiency_std) ** 2), rel=1e-9
    )
    assert found.objective < found.annealing_objective < 3.0 * found.objective
    assert asked[-1].value != found.annealing_objective  # of fewer samples
    np.testing.assert_allclose(found.parameters.to_array(), TRUTH.to_array(), rtol=0.1)


def test_no_answer_within_the_bounds(hm4):
    # 320 rad/s x 5000 N m is 1.6 MW: at this stroke the mildest leakage stalls.
    samples = hmcvt.BenchSamples([-1.0], [10.0], [5000.0], [0.5])
    leaky = replace(hm4, pump_motor=hmcvt.PumpMotor(1e-7, 1e-7))
    with pytest.raises(
        hmcvt.IdentificationError,
        match="no parameters within the bounds give an efficiency at every sample",
    ):
        hmcvt.identify(samples, stage=leaky, schedule=QUICK)


def flat(value):
    """Lists and mappings of a file as one mapping from place to value."""
    if not isinstance(value, (dict, list, tuple)):
        return {"": value}
    items = value.items() if isinstance(value, dict) else enumerate(value)
    return {
        f".{key}{place}": found
        for key, item in items
        for place, found in flat(item).items()
    }


def test_shipped_parameter_file_is_what_identification_gives(fitted):
    """`hmcvt identify data/table2.csv --fit 1,2,4,5,6`, all but the date."""
    shipped = flat(hmcvt.load_model(hmcvt.data_path("params/hm4.yaml")).to_mapping())
    made = flat(fitted.model.to_mapping())
    assert made[".provenance.date"].endswith("Z")
    del shipped[".provenance.date"], made[".provenance.date"]
    assert shipped.keys() == made.keys()
    for place, value in made.items():
        # Other processors round otherwise; the search ends at 1e-9 of the bounds.
        expected = pytest.approx(value, rel=1e-4) if isinstance(value, float) else value
        assert shipped[place] == expected, place
