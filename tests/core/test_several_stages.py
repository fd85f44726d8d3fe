# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bench samples of several stages: one set of parameters, and what one stage cannot settle."""

from dataclasses import replace

import numpy as np
import pytest
from cli.running import run

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.actuator import DisplacementOffset
from hmcvt_core.physics.effects.mechanical import ClutchDrag, GearEfficiency
from hmcvt_core.transmission.parameters import PARAMETER_NAMES

TRACTOR = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
STAGES = [each.stage for each in TRACTOR.stages.values()]
NOISE = 0.004
WORN = replace(TRACTOR, effects=(GearEfficiency(0.01),))


def bench(names, count, seed, model=TRACTOR, noise=NOISE):
    """Samples at random points, `count` in each stage named."""
    rng = np.random.default_rng(seed)
    stage = np.repeat(names, count)
    stroke, speed, torque = (
        rng.uniform(*ends, len(stage))
        for ends in ((-1.0, 1.0), (80.0, 220.0), (80.0, 350.0))
    )
    truth = model.efficiency(stroke, speed, torque, stage=stage)
    return hmcvt.BenchSamples(
        stroke,
        speed,
        torque,
        truth + rng.normal(0.0, noise, len(stage)),
        efficiency_std=np.full(len(stage), noise),
        extra={"stage": tuple(stage.tolist())},
    )


def test_parameters_are_those_of_all_stages():
    """24 samples in three stages say as much of the parameters as 24 in one: same units.

    Median standard errors (leakage, f_m, f_p) of six benches each: 1.45e-12, 0.0042, 0.0012 against
    1.67e-12, 0.0040, 0.0012.
    """
    said, true = {}, TRACTOR.parameters.to_array()
    for names, count in ((("HM1", "HM2", "HM4"), 8), (("HM4",), 24)):
        fits = [
            hmcvt.identify(
                bench(names, count, seed),
                stage=STAGES,
                schedule=hmcvt.Schedule(chains=8, moves=2),
            )
            for seed in (1, 2)
        ]
        errors = np.array([list(fit.standard_errors.values()) for fit in fits])
        found = np.array([fit.parameters.to_array() for fit in fits])
        assert (np.abs(found - true) < 4.5 * errors).all()
        assert list(fits[0].model.stages) == list(TRACTOR.stages)
        assert list(fits[0].alone) == ([] if len(names) == 1 else list(names))
        said[len(names)] = errors.mean(axis=0)
    np.testing.assert_allclose(said[3], said[1], rtol=0.4)


def test_stages_separate_clutches_and_stroke():
    """In HM4 the stroke makes up for what four clutches drag; elsewhere others are open."""
    found = {}
    for names, count in ((("HM2", "HM3", "HM4"), 8), (("HM4",), 24)):
        samples = bench(names, count, 7, noise=1e-6)
        base, steps = TRACTOR.parameters.to_array(), np.diag([1e-13, 1e-3, 1e-3])
        here = TRACTOR.efficiency(*samples.points)
        moved = TRACTOR.efficiency_of_candidates(base + steps, samples.points) - here
        worse, other = (
            replace(TRACTOR, effects=(each,)).efficiency(*samples.points) - here
            for each in (ClutchDrag(6.0), DisplacementOffset(0.015))
        )
        columns = np.stack(
            [
                *(moved / np.abs(moved).max(axis=1, keepdims=True)),
                other / np.abs(other).max(),
            ]
        )
        left = worse - columns.T @ np.linalg.lstsq(columns.T, worse, rcond=None)[0]
        found[len(names)] = float((left**2).sum()) / NOISE**2
    assert found[3] > 5.0 * max(found[1], 1.0), found


def test_report_says_what_each_stage_contributes():
    fit = hmcvt.identify(bench(("HM2", "HM4"), 10, 3), stage=STAGES)
    alone = fit.to_dict()["stages"]
    for name in PARAMETER_NAMES:  # together they know more than each by itself
        assert fit.standard_errors[name] < min(
            alone[stage]["standard_errors"][name] for stage in ("HM2", "HM4")
        )
    text = fit.report()
    assert (
        "stages HM2, HM4: fitted to 20 samples" in text
        and "samples of HM4 alone" in text
    )


def test_from_the_command_line_through_files(tmp_path):
    file, out = tmp_path / "bench.csv", tmp_path / "p.yaml"
    hmcvt.write_bench(file, bench(("HM1", "HM3"), 6, 5))
    done = run(
        "identify",
        file,
        "--params",
        hmcvt.data_path("params/tractor.yaml"),
        "--out",
        out,
    )
    assert done.code == 0 and "samples of HM1 alone" in done.out
    assert list(hmcvt.load_model(out).stages) == list(TRACTOR.stages)
    assert len(run("predict", file, "--params", out, "--json").json) == 12


def test_an_unknown_stage_or_none_is_named():
    samples = bench(("HM1",), 6, 1)
    with pytest.raises(hmcvt.InputError, match=r"stage .HM1. is not known .* HM4"):
        hmcvt.identify(samples)
    with pytest.raises(hmcvt.InputError, match="samples with a column stage"):
        hmcvt.identify(replace(samples, extra={}), stage=STAGES)


def test_the_gear_train_is_checked_stage_by_stage():
    samples = bench(("HM2", "HM4"), 12, 5)
    speed = TRACTOR.output_speed(*samples.points[:3], stage=samples.points.stage)
    right, wrong = (
        hmcvt.identify(
            replace(samples, output_speed=factor * speed),
            stage=STAGES,
            schedule=hmcvt.Schedule(chains=8, moves=2),
        )
        for factor in (1.0, 1.5)
    )
    assert not any("gear train" in line for line in (*right.warnings, right.report()))
    lines = wrong.report().splitlines()
    assert ["gear train" in line for line in lines[:3]] == [True, True, False]
    assert lines[:2] == list(wrong.warnings[:2]), (
        "each once, and nothing else is left out"
    )
    assert sum("gear train" in line for line in lines) == 2


@pytest.mark.long
@pytest.mark.slow
def test_gears_and_a_torque_meter_are_twins_in_one_stage_and_not_in_three():
    """Worse gears and the gain of a meter: HM1 has more pairs than HM4, the meter is the same."""
    one = hmcvt.diagnose(TRACTOR, bench(("HM4",), 24, 3, WORN), noise=NOISE)
    assert one.verdict == "ambiguous"
    assert {cause.effect for cause in one.causes[:2]} == {"gear_mesh", "torque_sensor"}
    three = hmcvt.diagnose(
        TRACTOR, bench(("HM1", "HM3", "HM4"), 12, 3, WORN), noise=NOISE
    )
    assert three.sets[0].effects == ("gear_mesh",)
    told = {cause.effect: cause.probability for cause in three.causes}
    assert told["gear_mesh"] > 0.6 and told.get("torque_sensor", 0.0) < 0.1
    assert list(three.model.stages) == list(TRACTOR.stages)


def test_a_sample_without_its_stage_is_named():
    samples = bench(("HM1", "HM4"), 6, 3)
    wrong = (samples.extra["stage"][0], "HM9", *samples.extra["stage"][2:])
    for ask in (hmcvt.diagnose, hmcvt.next_test, hmcvt.watch):
        with pytest.raises(
            hmcvt.InputError, match="column stage is missing; the model has H0, HM"
        ):
            ask(TRACTOR, replace(samples, extra={}), noise=NOISE)
        with pytest.raises(
            hmcvt.InputError, match="sample 2: stage 'HM9' is not known to the"
        ) as refused:
            ask(TRACTOR, replace(samples, extra={"stage": wrong}), noise=NOISE)
        assert "give a transmission or parameter file that has it" in str(refused.value)
    for ask in (hmcvt.diagnose, hmcvt.next_test):
        with pytest.raises(
            hmcvt.InputError, match="sample 2: stage 'HM1' is not known to"
        ):
            ask(
                TRACTOR.in_stage("HM4"),
                replace(samples, extra={"stage": ("HM4", *wrong[:-1])}),
            )
