# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""An output speed that the gear train rules out is the first thing told; one it allows is not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import hmcvt_core as hmcvt
from hmcvt_core.identification.refit import refit
from hmcvt_core.model.plausibility import gear_train_remark, pressure_remark
from hmcvt_core.physics.effects.actuator import (
    DisplacementDeadBand,
    DisplacementGain,
    DisplacementLag,
    DisplacementOffset,
)
from hmcvt_core.transmission.ranges import OperatingPoints


@pytest.fixture(scope="module")
def samples():
    return hmcvt.read_bench(hmcvt.data_path("data/simulated.csv"))


def measured(stage, effects=(), leakage=2e-11, n=96, seed=0):
    """What a bench with that stage reads all over the working range."""
    rng = np.random.default_rng(seed)
    speed = rng.uniform(78.5, 230.0, n)
    points = OperatingPoints(
        rng.uniform(-1.0, 1.0, n), speed, rng.uniform(18e3, 85e3, n) / speed
    )
    truth = hmcvt.EfficiencyModel(
        stage, hmcvt.HydraulicParameters(leakage, 0.12, 0.2), effects=effects
    )
    efficiency, output, _ = truth.solution_at(points)
    output = output * (1.0 + 0.001 * rng.standard_normal(n))
    known = np.isfinite(efficiency)
    return hmcvt.BenchSamples(
        *(row[known] for row in (*points[:3], efficiency, output))
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda s: {"output_speed": s.output_speed * 2.0},
            "0 is 2.39, the file says 1.20",
        ),
        (
            lambda s: {"displacement_ratio": -s.displacement_ratio},
            "it by -0.36, the file says +0.36",
        ),
        (lambda s: {"output_speed": s.engine_speed}, "the ratio at stroke 0 is 1.00"),
    ],
)
def test_mistakes_are_the_first_thing_told(samples, hm4, change, words):
    assert gear_train_remark(hm4, samples) is None
    wrong = replace(samples, **change(samples))
    remark = gear_train_remark(hm4, wrong)
    assert words in remark
    assert "check the stage" in remark
    found = hmcvt.identify(wrong)
    assert found.warnings[0] == remark
    assert found.report().startswith(f"{remark}\npower_balance, stage HM4")
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    assert refit(wrong, model, model).warnings[0] == remark


# Pairs of Table 1 in the place of those of HM4.
OTHERS = {
    "output": ("12", "11"),
    "motor": ("9",),
    "mechanical": ("2", "12"),
    "pump": ("1",),
}


@pytest.mark.parametrize("path", OTHERS)
@pytest.mark.parametrize("n", [8, 96])
def test_data_of_another_stage_are_told(hm4, path, n):
    data = yaml.safe_load(
        Path(hmcvt.data_path("params/transmission.yaml")).read_bytes()
    )
    data["stages"]["HM4"][path]["gear_pairs"] = [int(name) for name in OTHERS[path]]
    other = hmcvt.Stage.from_mapping(data)
    bench = measured(other, n=n)
    assert gear_train_remark(other, bench) is None
    assert "the output speed is of another gear train" in gear_train_remark(hm4, bench)


@pytest.mark.parametrize(
    "effect",
    [
        *(
            kind(sign * 0.1)
            for kind in (DisplacementOffset, DisplacementGain, DisplacementLag)
            for sign in (-1.0, 1.0)
        ),
        DisplacementDeadBand(0.15),
    ],
    ids=repr,
)
@pytest.mark.parametrize("leakage", [1e-12, 2e-11, 1e-10])
def test_neither_an_actuator_nor_leakage_is_another_gear_train(hm4, effect, leakage):
    for n, seed in ((8, 1), (24, 2), (96, 3)):
        assert (
            gear_train_remark(hm4, measured(hm4, (effect,), leakage, n, seed)) is None
        )


def test_outliers_are_no_mistake_of_a_column(samples, hm4):
    speed = samples.output_speed.copy()
    speed[[3, 40]] *= 3.0, 0.2
    assert gear_train_remark(hm4, replace(samples, output_speed=speed)) is None
    assert gear_train_remark(hm4, replace(samples, output_speed=None)) is None


def test_diagnosis_says_it_before_it_names_a_cause(samples):
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    few = samples.select(np.arange(12))
    wrong = replace(
        few, output_speed=1.09 * few.output_speed, pressure=250.0 * np.ones(12)
    )  # in bar
    found = hmcvt.diagnose(model, wrong)
    assert found.notes[:2] == (
        gear_train_remark(model.stage, wrong),
        pressure_remark(model, wrong),
    )
    assert found.notes[0] == found.to_dict()["notes"][0]
    assert "0 is 1.30, the file says 1.20" in found.notes[0]
