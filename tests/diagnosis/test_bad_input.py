# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bad input: a clear refusal or a sane answer, never another exception."""

import json
from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.mechanical import ChargePump

from .campaigns import BASE, NOISE, campaign, with_column

SAMPLES = campaign((ChargePump(8.0),), seed=2, n=40)
QUIET = campaign(seed=2, n=40).select(np.arange(24))


def _sane(found):
    json.dumps(found.to_dict(), allow_nan=False)
    assert found.report()
    assert 0.0 < found.gap.p_value <= 1.0
    return found


@pytest.mark.parametrize("n", [1, 4])
def test_fewer_samples_than_can_tell(n):
    with pytest.raises(hmcvt.InputError, match=f"{n} samples .*at least 5"):
        hmcvt.diagnose(BASE, SAMPLES.select(np.arange(n)), noise=NOISE)


def test_all_samples_at_one_point():
    rng = np.random.default_rng(0)
    same = SAMPLES.select(np.zeros(20, dtype=int))
    read = with_column(
        same, efficiency=same.efficiency + 0.002 * rng.standard_normal(20)
    )
    with pytest.raises(hmcvt.InputError, match="1 distinct operating point"):
        hmcvt.diagnose(BASE, read, noise=NOISE)
    with pytest.raises(hmcvt.InputError, match=r"1 samples \(rows that differ\)"):
        hmcvt.diagnose(BASE, same, noise=NOISE)


@pytest.mark.parametrize(
    ("column", "value", "effects"),
    [
        pytest.param("displacement_ratio", 0.0, (), marks=pytest.mark.long),
        pytest.param("oil_temperature", 60.0, (), marks=pytest.mark.long),
        ("load_torque", 200.0, (ChargePump(8.0),)),
    ],
)
def test_a_constant_column(column, value, effects):
    """The plan itself holds one axis still; nothing else is wrong."""
    points = {
        name: getattr(QUIET, name)[:16]
        for name in ("displacement_ratio", "engine_speed", "load_torque")
    }
    n = 16
    oil = np.full(n, value) if column == "oil_temperature" else None
    if column in points:
        points[column] = np.full(n, value)
    truth = hmcvt.EfficiencyModel(BASE.stage, BASE.parameters, effects=effects)
    noise = np.random.default_rng(3).standard_normal((2, n))
    read = hmcvt.BenchSamples(
        **points,
        efficiency=truth.efficiency(**points) + NOISE * noise[0],
        output_speed=truth.output_speed(**points) * (1.0 + 0.001 * noise[1]),
        oil_temperature=oil,
    )
    found = _sane(hmcvt.diagnose(BASE, read, noise=NOISE))
    if not effects:
        assert found.verdict == "no_gap"
    for cause in found.causes:
        # One temperature is no sweep: nothing in these data speaks of viscosity.
        assert cause.effect != "oil_temperature"


@pytest.mark.parametrize(
    "noise", [0, 0.0, -0.003, float("nan"), float("inf"), 1.12, "much"]
)
def test_noise_and_formulation_that_cannot_be(noise):
    published = hmcvt.EfficiencyModel(
        BASE.stage, BASE.parameters, formulation="published"
    )
    for act in (hmcvt.diagnose, hmcvt.separable):
        with pytest.raises(hmcvt.InputError, match=r"noise"):
            act(BASE, SAMPLES, noise=noise)
        with pytest.raises(hmcvt.InputError, match="power_balance"):
            act(published, SAMPLES, noise=NOISE)


def test_samples_the_model_cannot_carry():
    """Two points beyond stall among good ones, and then too many."""
    odd = with_column(
        QUIET, load_torque=np.where(np.arange(24) < 2, 4000.0, QUIET.load_torque)
    )
    found = _sane(hmcvt.diagnose(BASE, odd, noise=NOISE))
    assert (found.verdict, found.gap.samples) == ("no_gap", 22)
    assert found.notes[0].startswith(
        "1 samples ask for a load that the model cannot carry and "
        "were left out: sample 2 (displacement ratio"
    )
    assert found.notes[1].startswith("sample 1 (displacement ratio"), "it fits nothing"
    assert f"efficiency {odd.efficiency[0]:.4g}, stands alone" in found.notes[1]
    of_file = replace(odd, rows=tuple(range(2, 26)))
    notes = hmcvt.diagnose(BASE, of_file, noise=NOISE).notes
    assert "left out: row 3 (displacement ratio" in notes[0]
    assert notes[1].startswith("row 2 (displacement ratio")
    most = with_column(QUIET, load_torque=np.full(24, 4900.0))
    with pytest.raises(
        hmcvt.InputError, match=r"15 of 24 samples ask .* check load_torque"
    ):
        hmcvt.diagnose(BASE, most, noise=NOISE)
