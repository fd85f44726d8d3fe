# SPDX-License-Identifier: Apache-2.0
"""A model that the diagnosis wrote, with the effect in it, is served like any other."""

from __future__ import annotations

import numpy as np
from ros_bench import GOOD

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.gears import PlanetaryMesh


def test_the_node_serves_a_diagnosed_model(start_node, tmp_path):
    stage = hmcvt.load_stage(hmcvt.data_path("params/transmission.yaml"))
    parameters = hmcvt.HydraulicParameters(2e-11, 0.12, 0.2)
    plant = hmcvt.EfficiencyModel(stage, parameters, effects=(PlanetaryMesh(0.08),))
    rng = np.random.default_rng(0)
    ratio, speed = rng.uniform(-1.0, 1.0, 60), rng.uniform(80.0, 230.0, 60)
    torque = np.clip(rng.uniform(18e3, 60e3, 60) / speed, 40.0, 400.0)
    efficiency = plant.efficiency(ratio, speed, torque) + 0.003 * rng.standard_normal(60)
    output = plant.output_speed(ratio, speed, torque)
    output = output * (1.0 + 0.001 * rng.standard_normal(60))
    samples = hmcvt.BenchSamples(ratio, speed, torque, efficiency, output_speed=output)
    found = hmcvt.diagnose(hmcvt.EfficiencyModel(stage, parameters), samples, noise=0.003)
    path = tmp_path / "diagnosed.yaml"
    hmcvt.save_model(found.model, path)
    assert [effect.name for effect in hmcvt.load_model(path).effects] == ["planetary_mesh"]

    answer = start_node(path).player.hold(GOOD)

    assert answer.efficiency == found.model.efficiency(*GOOD)
    assert answer.efficiency != found.base.efficiency(*GOOD)
