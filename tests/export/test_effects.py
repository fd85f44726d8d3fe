# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Effects become tables whose bound holds; they are never left out."""

import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from cli.running import HM4, assert_refused, run

import hmcvt_core as hmcvt
import hmcvt_tools
from export.c_library import Library, compile_c, needs_compiler
from export.effect_cases import CASES, THREE_EFFECTS, affected_model, points_of_tables
from hmcvt_core.physics.effects.hydraulic import PortPressureDrop
from hmcvt_core.physics.effects.sensor import EngineTorqueGain
from hmcvt_core.transmission.ranges import OperatingPoints
from hmcvt_tools.export import effect_tables
from hmcvt_tools.export.effect_tables import BOUND, TABLE_SPEED

pytestmark = [needs_compiler, pytest.mark.slow]

POINTS = 30_000


# The first case has more effects and stages, the last one an effect that is not listed either.
LONG_CASES = ("the same without clutches, pump on the row", "effect of a user")


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(name, marks=[pytest.mark.long] * (name in LONG_CASES))
        for name in CASES
    ],
)
def case(request, tmp_path_factory):
    model = affected_model(request.param)
    folder = tmp_path_factory.mktemp("effects") / "c"
    accuracy = hmcvt_tools.export_c(model, folder)
    return model, folder, accuracy, Library(folder, model)


def test_bound_holds_at_fresh_points(case):
    model, _, accuracy, library = case
    assert 0.0 < accuracy.bound <= BOUND
    errors = []
    differing = []
    for number, part in enumerate(model.stages.values()):
        points = points_of_tables(100 + number, POINTS)
        answer, _ = library.predict(number, *points)
        solution = part.solution_at(OperatingPoints(*points))
        errors.append(np.abs(answer["efficiency"] - solution.efficiency))
        speed = np.abs(answer["output_speed"] - solution.output_speed) / points[1]
        assert np.nanquantile(speed, 0.99) < 1e-3
        one = np.isnan(answer["engine_torque"]) != np.isnan(solution.engine_torque)
        differing.append(one)
    assert np.nanquantile(np.concatenate(errors), 0.99) <= BOUND
    assert np.mean(np.concatenate(differing)) < 0.002


def test_tables_matter(case):
    """Without them the error would be far larger than the bound."""
    model = case[0]
    points = points_of_tables(7, POINTS)
    part = next(iter(model.stages.values()))
    bare = replace(part, effects=())
    error = np.abs(bare.efficiency(*points) - part.efficiency(*points))
    assert np.nanquantile(error, 0.99) > 2.0 * BOUND


def test_optimum_with_effects(case):
    model, _, _, library = case
    rng = np.random.default_rng(3)
    speed = rng.uniform(80.0, 230.0, 20)
    load = rng.uniform(30.0, 300.0, 20)
    for number, part in enumerate(model.stages.values()):
        answer, _ = library.stroke(number, speed, load)
        best = part.optimal_displacement_ratio(speed, load)
        known = np.isfinite(best.efficiency)
        assert np.array_equal(np.isfinite(answer["efficiency"]), known)
        error = np.abs(answer["efficiency"] - best.efficiency)[known]
        assert np.all(error < 2.0 * BOUND)


def test_self_test_passes_and_says_the_bound(case):
    model, folder, accuracy, _ = case
    flags = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    program = compile_c(folder, folder / "check", *flags, "hmcvt_model.c", "check.c")
    done = subprocess.run(
        [program, "vectors.csv"], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert accuracy.report() in (folder / "README.md").read_text()
    header = (folder / "hmcvt_model.h").read_text()
    assert f"tables of {accuracy.nodes} nodes" in header
    assert str(TABLE_SPEED) in header
    assert model.fingerprint in header


def test_inputs_beyond_the_tables_are_out_of_range(case):
    library = case[3]
    for point in ((0.1, 30.0, 100.0), (0.1, 300.0, 100.0), (0.1, 150.0, 2000.0)):
        _, status = library.predict(0, *(np.array([value]) for value in point))
        assert status[0] == 2


def test_single_precision(tmp_path):
    model = replace(hmcvt.load_model(HM4), effects=THREE_EFFECTS)
    hmcvt_tools.export_c(model, tmp_path / "c", "single")
    points = points_of_tables(9, POINTS)
    answer, _ = Library(tmp_path / "c", model, "single").predict(0, *points)
    error = np.abs(answer["efficiency"] - model.efficiency(*points))
    assert np.nanquantile(error, 0.99) < 0.002


def test_command_prints_the_bound(tmp_path):
    path = tmp_path / "model.yaml"
    hmcvt.save_model(replace(hmcvt.load_model(HM4), effects=THREE_EFFECTS), path)
    out = tmp_path / "c"
    done = run("export", "--params", path, "--format", "c", "--out", out)
    assert done.code == 0, done.err
    assert "efficiency within" in done.out and "of 100000 random points" in done.out
    base = ("export", "--params", path, "--format", "c", "--out", tmp_path / "d")
    assert_refused(run(*base, "--bound", "0"), "bound")


def test_too_small_a_bound_names_one_that_is_attainable(tmp_path, monkeypatch):
    monkeypatch.setattr(effect_tables, "_MAX_NODES", 3000)
    model = replace(hmcvt.load_model(HM4), effects=(PortPressureDrop(drop=4.9e6),))
    with pytest.raises(hmcvt.InputError, match="allow a larger bound") as refused:
        hmcvt_tools.export_c(model, tmp_path / "c", bound=1e-4)
    assert list(tmp_path.iterdir()) == []
    message = str(refused.value)
    assert "\n" not in message
    (attainable,) = re.findall(r"([\d.e-]+) is attainable", message)
    accuracy = hmcvt_tools.export_c(model, tmp_path / "c", bound=float(attainable))
    assert accuracy.bound <= float(attainable)


@pytest.mark.long
def test_the_stage_with_the_largest_error_decides_what_is_attainable(
    tmp_path, monkeypatch
):
    """A bound that the first stage keeps is of no use where another does not."""
    monkeypatch.setattr(effect_tables, "_MAX_NODES", 3000)
    tractor = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    stages = [tractor.in_stage(name).stage for name in ("HM1", "H0")]
    model = replace(
        tractor, stage=stages[0], other_stages=(stages[1],), effects=THREE_EFFECTS
    )
    attainable = {}
    for name in model.stages:
        with pytest.raises(effect_tables.BoundError) as refused:
            effect_tables.effect_tables(model.in_stage(name), 1e-4)
        attainable[name] = refused.value.attainable
    with pytest.raises(effect_tables.BoundError) as refused:
        hmcvt_tools.export_c(model, tmp_path / "c", bound=1e-4)
    assert attainable["H0"] > attainable["HM1"]
    assert refused.value.attainable == attainable["H0"]
    assert str(refused.value).startswith("stage H0: ")
    effect_tables.effect_tables(model, refused.value.attainable)


def test_errors_of_meters_stay_with_the_bench(tmp_path):
    model = replace(hmcvt.load_model(HM4), effects=(EngineTorqueGain(gain=0.02),))
    assert hmcvt_tools.export_c(model, tmp_path / "c") is None
    points = points_of_tables(11, POINTS)
    answer, _ = Library(tmp_path / "c", model).predict(0, *points)
    expected = model.without_meters().efficiency(*points)
    np.testing.assert_array_equal(answer["efficiency"], expected)


def test_fmu_holds_the_effects(tmp_path):
    fmpy = pytest.importorskip("fmpy")
    model = replace(hmcvt.load_model(HM4), effects=THREE_EFFECTS)
    path = tmp_path / "hm4.fmu"
    accuracy = hmcvt_tools.export_fmu(model, path)
    assert accuracy is not None
    result = fmpy.simulate_fmu(
        str(path),
        start_values={
            "displacement_ratio": 0.4,
            "engine_speed": 150.0,
            "load_torque": 200.0,
        },
        output=["efficiency"],
        stop_time=0.1,
    )
    description = fmpy.read_model_description(str(path)).description
    assert accuracy.report() in description
    expected = model.efficiency(0.4, 150.0, 200.0)
    assert abs(result["efficiency"][-1] - expected) < 0.002
