# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A system with one axis: a wind turbine whose rotor may face beside the wind."""

from functools import cache

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.diagnosis.results.outcome import BASE
from hmcvt_tools.report import write_report

NOISE = {"power": 4.0, "thrust": 0.6}  # W, N


def turbine(points, *, power_coefficient, yaw=0.0, gear_drag=0.0):
    wind = points["wind"]
    pressed = 7.2 * wind**2 * (1.0 - yaw)
    facing = (1.0 - yaw) ** 0.5
    power = power_coefficient * pressed * wind * facing - gear_drag * wind
    return {"power": power, "thrust": 0.8 * pressed}


SYSTEM = hmcvt.Simulator(
    function=turbine,
    axes=(hmcvt.Axis.of("wind", "m/s", digits=1),),
    channels=(
        hmcvt.Channel.of("power", "W", NOISE["power"]),
        hmcvt.Channel.of("thrust", "N", NOISE["thrust"]),
    ),
    parameters=(hmcvt.Parameter("power_coefficient", "-", 0.42, 0.01, low=0.0),),
    effects=(
        hmcvt.Switch("yaw", "-", 0.02, 0.0, 0.5, component="yaw drive"),
        hmcvt.Switch("gear_drag", "N", 3.0, 0.0, 30.0, component="gear"),
    ),
)


def diagnosed_turbine(change):
    rng = np.random.default_rng(4)
    points = {"wind": rng.uniform(3.5, 12.0, 30)}
    readings = change(points, turbine(points, power_coefficient=0.42))
    for name, noise in NOISE.items():
        readings[name] = readings[name] + noise * rng.standard_normal(30)
    samples = hmcvt.observe_system(SYSTEM, {**points, **readings}, noise=NOISE)
    return hmcvt.diagnose_system(SYSTEM, samples)


@cache
def yawed():
    return diagnosed_turbine(
        lambda points, _: turbine(points, power_coefficient=0.42, yaw=0.09)
    )


@pytest.mark.parametrize("ending", ["html", "pdf"])
def test_its_page_has_no_map(tmp_path, ending):
    page = tmp_path / f"turbine.{ending}"
    assert yawed().verdict == "cause_found"
    write_report(yawed(), str(page))
    content = page.read_bytes()
    assert len(content) > 5000
    assert b"lead-map" not in content


def test_its_map_is_refused():
    with pytest.raises(hmcvt.InputError, match="needs two axes"):
        yawed().plot(of="gap")


def test_the_base_model_is_kept_where_a_set_makes_the_gap_grow():
    # The thrust alone falls: what a yaw error takes from it, it would take from the power too.
    def weaker_thrust(points, readings):
        return {**readings, "thrust": 0.98 * readings["thrust"]}

    found = diagnosed_turbine(weaker_thrust)
    assert found.gap.significant
    assert found.delivered.kind == BASE
    assert found.delivered.rmse_after <= found.delivered.rmse_before
    assert found.model == found.base
