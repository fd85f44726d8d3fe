# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Intervals of parameters and predictions with few tests; fast and refused scalar input."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import t as student

import hmcvt_core as hmcvt
from hmcvt_core.errors import InputError
from hmcvt_core.files import data_path
from hmcvt_core.identification.problem import Problem
from hmcvt_core.identification.refit import refit
from hmcvt_core.model.intervals import half_width
from hmcvt_core.model.parameter_file import load_model, save_model
from hmcvt_core.transmission.parameters import SEARCH_BOUNDS, to_scaled

from .test_speed import times_faster

POINT = (0.5, 146.6, 200.0)


@pytest.fixture(scope="module")
def unstated():
    """Tests without `efficiency_std`, of a known leakage of 1.5e-11 m3/(s Pa)."""
    return replace(
        hmcvt.read_bench(data_path("data/simulated.csv")), efficiency_std=None
    )


@pytest.fixture(scope="module")
def four(unstated):
    return hmcvt.identify(unstated.select(np.arange(4)))


def test_leakage_at_its_bound_gets_a_wide_error(four):
    low, high = four.model.parameter_intervals()["leakage"]
    assert four.parameters.leakage == pytest.approx(1e-13)
    assert low <= 1.5e-11 <= high
    assert four.standard_errors["leakage"] > 1e-12


def test_intervals_of_four_tests_hold_the_other_tests(four, unstated):
    others = unstated.select(np.arange(4, len(unstated)))
    inside = four.model.domain.contains(*others.points[:3])
    low, high = four.model.interval(*others.points[:3], level=0.95)
    held = (low <= others.efficiency) & (others.efficiency <= high)
    assert held[inside].mean() > 0.9


def test_interval_is_of_student(four):
    assert four.model.degrees_of_freedom == 1.0
    prediction = four.model.predict(*POINT)
    _, high = four.model.interval(*POINT, level=0.5)
    expected = student.ppf(0.75, 1.0) * prediction.standard_error
    assert high - prediction.efficiency == pytest.approx(expected)


def test_stated_noise_gives_normal_intervals(unstated):
    stated = hmcvt.read_bench(data_path("data/simulated.csv"))
    result = hmcvt.identify(stated.select(np.arange(8)))
    assert result.model.degrees_of_freedom is None
    assert half_width(None) == pytest.approx(1.6449, abs=1e-4)


def test_file_keeps_degrees_of_freedom(four, tmp_path):
    save_model(four.model, tmp_path / "m.yaml")
    assert load_model(tmp_path / "m.yaml").degrees_of_freedom == 1.0


def test_refit_adds_its_tests_to_the_degrees_of_freedom(four, unstated):
    refitted = refit(unstated, four.model, four.model)
    assert refitted.model.degrees_of_freedom > 10.0


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan")])
def test_degrees_of_freedom_below_one_are_refused(four, wrong):
    with pytest.raises(InputError, match="degrees_of_freedom"):
        replace(four.model, degrees_of_freedom=wrong)


NO_NUMBERS = [
    "0.3",
    True,
    ["0.1", "0.2"],
    np.array([True]),
    [0.3, True],
    [[0.3], [np.True_]],
    np.array([0.3, True], dtype=object),
    0.3 + 0.1j,
    np.array([0.3 + 0.1j]),
    np.timedelta64(0, "s"),
]


@pytest.mark.parametrize("wrong", NO_NUMBERS)
def test_what_is_no_number_is_no_stroke(model, wrong):
    calls = (
        model.efficiency,
        model.power_loss,
        model.breakdown,
        model.predict,
        model.efficiency_map,
    )
    for call in calls:
        with pytest.raises(InputError, match="displacement_ratio"):
            call(wrong, 146.6, 200.0)
    with pytest.raises(InputError, match="displacement_ratio"):
        model.optimal_displacement_ratio(
            146.6, 200.0, hold="output_speed", displacement_ratio=wrong
        )


@pytest.mark.parametrize("wrong", NO_NUMBERS)
def test_what_is_no_number_is_no_speed_torque_or_level(model, wrong):
    engine = hmcvt.load_engine(data_path("params/engine.yaml"))
    calls = (
        lambda: model.interval(*POINT, level=wrong),
        lambda: model.optimal_drive(wrong, 40e3),
        lambda: engine.full_load_torque(wrong),
        lambda: engine.fuel_rate(150.0, wrong),
        lambda: engine.interpolation_error(wrong, 200.0),
    )
    for call in calls:
        with pytest.raises(InputError, match="is not a number"):
            call()


@pytest.mark.parametrize("wrong", [10**400, 2, np.float32(1.5), np.int64(-2)])
def test_numbers_out_of_range_are_refused(model, wrong):
    with pytest.raises(InputError, match="displacement_ratio"):
        model.efficiency(wrong, 146.6, 200.0)


@pytest.mark.parametrize("kind", [float, np.float64, np.float32])
def test_scalar_types_give_the_answer_of_arrays(tractor, kind):
    point = (kind(0.5), 146, np.int64(200))
    for name in tractor.stages:
        array = tractor.power_loss(*(np.array([value]) for value in point), stage=name)
        assert np.array_equal(
            tractor.power_loss(*point, stage=name), array[0], equal_nan=True
        )
        assert type(tractor.efficiency(*point, stage=name)) is float


def test_predict_at_a_point_is_predict_of_arrays(four):
    at_point = four.model.predict(*POINT)
    of_arrays = four.model.predict(*(np.array([value]) for value in POINT))
    assert at_point.efficiency == of_arrays.efficiency[0]
    assert at_point.standard_error == pytest.approx(
        of_arrays.standard_error[0], rel=1e-6
    )
    assert at_point.inside_domain is bool(of_arrays.inside_domain[0])


def test_masked_points_stay_masked(four):
    strokes = np.ma.masked_array([0.5, 99.0, -0.2], mask=[False, True, False])
    efficiency = four.model.efficiency(strokes, 146.6, 200.0)
    assert efficiency.mask.tolist() == [False, True, False]
    assert efficiency[0] == four.model.efficiency(0.5, 146.6, 200.0)
    assert four.model.predict(strokes, 146.6, 200.0).standard_error.mask.any()
    assert four.model.power_loss(strokes, 146.6, 200.0).mask[1]
    _, slopes = four.model.sensitivity(strokes, 146.6, 200.0)
    assert slopes.mask[1].all()
    assert not slopes.mask[0].any()


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_masked_points_have_intervals_whatever_their_number(four, count):
    strokes = np.linspace(-0.5, 0.5, count + 1)
    masked = np.ma.masked_array(strokes, mask=np.arange(count + 1) == count)
    prediction = four.model.predict(masked, 146.6, 200.0)
    expected = four.model.predict(strokes[:count], 146.6, 200.0)
    for values, alone in zip(prediction, expected, strict=True):
        assert values.mask.tolist() == count * [False] + [True]
        np.testing.assert_allclose(values[:count], alone, rtol=1e-9)
    low, high = four.model.interval(masked, 146.6, 200.0)
    assert low.mask[count] and high.mask[count] and (low[:count] < high[:count]).all()


def test_masked_values_are_refused_where_no_mask_is_kept(four):
    model = four.model
    masked = np.ma.masked_array([0.5, 0.6], mask=[False, True])
    speeds = np.ma.masked_array([150.0, 160.0], mask=[False, True])
    calls = (
        lambda: model.breakdown(masked, 146.6, 200.0),
        lambda: model.optimal_displacement_ratio(speeds, 200.0),
        lambda: model.efficiency_map(masked, [146.6], [200.0]),
        lambda: replace(four.samples.select([0, 1]), displacement_ratio=masked),
    )
    for call in calls:
        with pytest.raises(InputError, match="masked"):
            call()


@pytest.fixture(scope="module")
def tractor():
    return load_model(data_path("params/tractor.yaml"))


@pytest.mark.parametrize(
    "point",
    [(0.5, 146, 200), tuple(map(np.float64, POINT)), (np.float32(0.5), 146.6, 200.0)],
)
def test_scalars_of_other_types_are_as_fast(tractor, point):
    alone = tractor.stages["HM3"]
    ratio = times_faster(
        lambda: tractor.efficiency(*point, stage="HM3"),
        lambda: alone.efficiency(*POINT),
        calls=2000,
    )
    # An array would take three hundred times as long.
    assert ratio > 0.25


def test_predict_at_a_point_takes_few_lookups(four):
    def look_up():
        for _ in range(20):
            four.model.efficiency(*POINT)

    ratio = times_faster(lambda: four.model.predict(*POINT), look_up, calls=200)
    assert ratio > 1.0


def test_motor_held_by_friction_is_named():
    model = load_model(data_path("params/hydrostatic.yaml"))
    held = replace(
        model, parameters=replace(model.parameters, leakage=1e-9, motor_damping=5.0)
    )
    strokes = np.linspace(-1.0, 1.0, 401)
    unloaded = held.output_speed(strokes, 100.0, 0.0)
    standing = strokes[(unloaded == 0.0)]
    assert standing.size
    assert "friction holds the motor" in held.refusal(standing[0], 100.0, 200.0)


def collinear(seed, count=12):
    """Tests whose displacement ratio, speed and torque rise together; and the true parameters."""
    rng = np.random.default_rng(seed)
    truth = hmcvt.HydraulicParameters(10.0 ** rng.uniform(-11.2, -10.5), 0.1, 0.2)
    stage = hmcvt.load_stage(data_path("params/transmission.yaml"))
    along = rng.uniform(size=count) + rng.uniform(-0.025, 0.025, (3, count))
    low, high = np.array([[-0.9, 1.0], [100.0, 210.0], [120.0, 500.0]]).T
    points = np.clip((low + along.T * (high - low)).T, low[:, None], high[:, None])
    efficiency = hmcvt.EfficiencyModel(stage, truth).efficiency(*points)
    noise = 0.0112 * rng.standard_normal(count)
    return hmcvt.BenchSamples(*points, efficiency * (1.0 + noise)), truth


def squares_with(problem, axis, value, start):
    """Least squares with one scaled variable held, the others within their bounds."""
    free = [i for i in range(3) if i != axis]

    def residuals(others):
        variables = np.empty(3)
        variables[free] = others
        variables[axis] = value
        return np.nan_to_num(problem.residuals(variables), nan=1e3)

    bounds = SEARCH_BOUNDS[free].T
    likely = np.array([-10.6, 0.1, 0.1])
    starts = [start[free], likely[free], bounds.mean(axis=0)]
    fits = [
        least_squares(residuals, np.clip(at, *bounds), bounds=bounds, method="dogbox")
        for at in starts
    ]
    return 2.0 * min(fit.cost for fit in fits)


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_intervals_of_tied_parameters_end_where_the_squares_rise(seed):
    samples, _ = collinear(seed)
    result = hmcvt.identify(samples)
    problem = Problem(result.model, result.samples)
    best = to_scaled(result.parameters.to_array())
    lowest = np.sum(problem.residuals(best) ** 2)
    free = len(result.samples) - 3
    expected = lowest * (1.0 + student.isf(0.05, free) ** 2 / free)
    ends = result.model.parameter_intervals()
    for axis, (name, pair) in enumerate(ends.items()):
        for side, end in enumerate(pair):
            bounds = SEARCH_BOUNDS[axis]
            value = np.log10(end) if name == "leakage" else end
            held = np.clip(value, *bounds)
            squares = squares_with(problem, axis, held, best)
            if held == bounds[side]:
                assert squares < 1.02 * expected
            else:
                assert squares == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("seeds", [10, pytest.param(40, marks=pytest.mark.long)])
def test_intervals_of_tied_parameters_hold_the_truth(seeds):
    held = []
    for seed in range(seeds):
        samples, truth = collinear(seed)
        ends = hmcvt.identify(samples).model.parameter_intervals()
        low, high = np.array([ends[name] for name in ends]).T
        held.append((low <= truth.to_array()) & (truth.to_array() <= high))
    # By standard errors 80 % of the leakages are inside.
    assert np.mean(held, axis=0).min() >= 0.85


def test_file_keeps_the_intervals(four, tmp_path):
    save_model(four.model, tmp_path / "m.yaml")
    loaded = load_model(tmp_path / "m.yaml")
    assert loaded.parameter_intervals() == four.model.parameter_intervals()
    text = (tmp_path / "m.yaml").read_text().splitlines()
    damaged = [
        "  pump_damping: [0.1]" if "pump_damping: [" in line else line
        for line in text
        if "checksum" not in line
    ]
    (tmp_path / "m.yaml").write_text("\n".join(damaged))
    with pytest.raises(InputError, match=r"interval_90\.pump_damping = \[0\.1\]"):
        load_model(tmp_path / "m.yaml")
    exchanged = [line.replace("[0.1]", "[0.2, 0.1]") for line in damaged]
    (tmp_path / "m.yaml").write_text("\n".join(exchanged))
    with pytest.raises(InputError, match=r"pump_damping = .*: low is above high"):
        load_model(tmp_path / "m.yaml")
    elsewhere = [line.replace("[0.1]", "[5.0, 6.0]") for line in damaged]
    (tmp_path / "m.yaml").write_text("\n".join(elsewhere))
    message = (
        r"m\.yaml: interval_90\.pump_damping = \[5\.0, 6\.0\] does not hold parameters"
    )
    with pytest.raises(InputError, match=message):
        load_model(tmp_path / "m.yaml")


def test_file_of_changed_parameters_leaves_their_former_intervals_out(four, tmp_path):
    moved = replace(four.model.parameters, pump_damping=1.0)
    changed = replace(four.model, parameters=moved)
    save_model(changed, tmp_path / "m.yaml")
    loaded = load_model(tmp_path / "m.yaml")
    assert not loaded.intervals
    assert loaded.parameter_intervals() == changed.parameter_intervals()


def test_changed_parameters_have_the_intervals_of_their_errors(four):
    moved = replace(four.model.parameters, pump_damping=1.0)
    low, high = replace(four.model, parameters=moved).parameter_intervals()[
        "pump_damping"
    ]
    assert low < 1.0 < high


def test_readings_are_as_uncertain_as_the_fit_scatters(unstated):
    """Left-out samples alone said 0.62 of the variance of the noise at eight tests, median."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        samples = unstated.select(np.sort(rng.permutation(len(unstated))[:8]))
        result = hmcvt.identify(samples)
        scatter = np.sqrt(np.sum(result.residuals**2) / 5.0)
        assert result.model.misfit >= (1.0 - 1e-9) * scatter


def test_a_ragged_list_and_several_levels_are_refused(model):
    with pytest.raises(InputError, match=r"displacement_ratio = .* is not a number"):
        model.efficiency([[1.0], [0.5, 0.2]], 150.0, 200.0)
    with pytest.raises(InputError, match=r"level = .*needs a fraction"):
        model.parameter_intervals([0.9, 0.8])
