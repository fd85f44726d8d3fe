# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The exported C answers as Python does, in every stage and at any load."""

from dataclasses import replace

import numpy as np
import pytest
from core.made_up_stages import edge_points, made_up_model

import hmcvt_core as hmcvt
import hmcvt_tools
from export.c_library import Library, needs_compiler
from export.conftest import STAGES
from export.points import bits_differ, random_outputs, random_points
from hmcvt_core.transmission.ranges import ENGINE_SPEED_LIMITS, OperatingPoints

POINTS = 1_000_000
FEWER_POINTS = 200_000


@pytest.mark.parametrize(
    "count", [FEWER_POINTS, pytest.param(POINTS, marks=pytest.mark.long)]
)
@pytest.mark.parametrize(("name", "stage"), STAGES)
def test_double_precision_is_identical_bit_by_bit(exported, name, stage, count):
    built = exported(name)
    model = built.model.stages[stage]
    points = random_points(1, count)
    answer, status = built.library.predict(built.number(stage), *points)
    solution = model.solution_at(OperatingPoints(*points))
    assert bits_differ(answer["efficiency"], solution.efficiency) == 0
    assert bits_differ(answer["output_speed"], solution.output_speed) == 0
    assert bits_differ(answer["engine_torque"], solution.engine_torque) == 0
    loss = points[1] * (solution.engine_torque - points[2])
    assert bits_differ(answer["power_loss"], loss) == 0
    assert set(status) == {0, 1}
    assert np.array_equal(status == 1, np.isnan(solution.efficiency))
    inside = np.zeros(count, dtype=bool)
    if model.domain is not None:
        inside = model.domain.contains(*points)
    assert np.array_equal(answer["inside_domain"] == 1, inside)


@pytest.mark.parametrize(("name", "stage"), STAGES)
def test_single_precision_is_within_a_ten_thousandth(exported, name, stage):
    built = exported(name, "single")
    model = built.model.stages[stage]
    points = random_points(2, POINTS // 4, np.float32)
    answer, status = built.library.predict(built.number(stage), *points)
    efficiency = model.efficiency(*points)
    assert np.nanmax(np.abs(answer["efficiency"] - efficiency)) < 1e-4
    # Where the engine neither drives nor brakes, rounding decides whether it drags.
    differs = (status == 1) != np.isnan(efficiency)
    assert differs.sum() <= 2
    assert np.all(efficiency[differs] < 1e-4)


@pytest.mark.parametrize(("name", "stage"), STAGES)
def test_optimum_at_a_held_engine_speed(exported, name, stage):
    built = exported(name)
    rng = np.random.default_rng(3)
    speed = rng.uniform(10.0, 320.0, 300)
    load = np.exp(rng.uniform(0.0, np.log(5000.0), 300))
    answer, status = built.library.stroke(built.number(stage), speed, load)
    best = built.model.optimal_displacement_ratio(speed, load, stage=stage)
    assert bits_differ(answer["displacement_ratio"], best.displacement_ratio) == 0
    assert bits_differ(answer["efficiency"], best.efficiency) == 0
    assert np.array_equal(status == 1, np.isnan(best.efficiency))


@pytest.mark.parametrize(("name", "stage"), STAGES)
def test_optimum_at_a_held_output_speed(exported, name, stage):
    built = exported(name)
    speed, power = random_outputs(4, 60, built.model.stages[stage].stage)
    answer, status = built.library.speed(
        built.number(stage), speed, power, limits=ENGINE_SPEED_LIMITS
    )
    for row, code, output, watts in zip(answer, status, speed, power, strict=True):
        best = built.model.stages[stage].optimal_drive(float(output), float(watts))
        assert (code == 1) == np.isnan(best.efficiency)
        assert bits_differ(row["efficiency"], best.efficiency) == 0
        assert bits_differ(row["engine_speed"], best.engine_speed) == 0
        assert bits_differ(row["displacement_ratio"], best.displacement_ratio) == 0


@needs_compiler
@pytest.mark.parametrize("models", [2, pytest.param(6, marks=pytest.mark.long)])
@pytest.mark.parametrize("layout", ["input_coupled", "output_coupled", "hydrostatic"])
def test_made_up_stages_and_edges(tmp_path, layout, models):
    rng = np.random.default_rng(5)
    for number in range(models):
        model = made_up_model(rng, layout)
        folder = tmp_path / str(number)
        hmcvt_tools.export_c(model, folder)
        points = edge_points(rng, 20_000)
        answer, _ = Library(folder, model).predict(0, *points)
        solution = model.solution_at(OperatingPoints(*points))
        assert bits_differ(answer["efficiency"], solution.efficiency) == 0
        assert bits_differ(answer["output_speed"], solution.output_speed) == 0
        assert bits_differ(answer["engine_torque"], solution.engine_torque) == 0


@pytest.mark.parametrize("name", ["tractor", "output_coupled"])
def test_parameters_are_adjustable_at_run_time(exported, name):
    built = exported(name)
    parameters = hmcvt.HydraulicParameters(2.5e-11, 0.11, 0.03)
    points = random_points(6, 20_000)
    library = built.library
    identified = library.parameters
    library.parameters = parameters.to_array()
    try:
        for number, part in enumerate(built.model.stages.values()):
            answer, _ = library.predict(number, *points)
            calibrated = hmcvt.EfficiencyModel(part.stage, parameters)
            expected = calibrated.efficiency(*points)
            assert bits_differ(answer["efficiency"], expected) == 0
        library.parameters = np.array([1.0, 0.1, 0.1])
        _, status = library.predict(0, *points)
        assert set(status) == {2}
    finally:
        library.parameters = identified


def test_standard_error(exported):
    built = exported("hm4")
    points = random_points(7, 20_000)
    error, _ = built.library.std(0, *points)
    expected = built.model.predict(*points).standard_error
    assert np.array_equal(np.isnan(error), np.isnan(expected))
    assert np.nanmax(np.abs(error - expected)) < 1e-12


def test_standard_error_is_unknown_where_none_is_stated(exported):
    built = exported("hydrostatic")
    error, status = built.library.std(0, *random_points(8, 100))
    assert np.isnan(error).all()
    assert set(status) <= {0, 1}


def test_single_point_in_python_is_the_same(exported):
    built = exported("tractor")
    part = built.model.stages["HM3"]
    points = random_points(9, 2000)
    answer, _ = built.library.predict(built.number("HM3"), *points)
    single = [part.efficiency(*point) for point in np.array(points).T.tolist()]
    assert bits_differ(answer["efficiency"], np.array(single)) == 0


@needs_compiler
def test_standard_error_holds_the_misfit(tmp_path):
    shipped = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    model = replace(shipped, misfit=0.0123)
    hmcvt_tools.export_c(model, tmp_path / "c")
    points = random_points(7, 1000)
    error, _ = Library(tmp_path / "c", model).std(0, *points)
    expected = model.predict(*points).standard_error
    assert np.nanmin(error) >= 0.0123
    assert np.nanmax(np.abs(error - expected)) < 1e-12
