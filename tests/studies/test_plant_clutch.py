# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A closed clutch of the trial plants slips by the torque that it passes."""

import numpy as np
import pytest

from studies.blind.bench.plant import Settings, Stand
from studies.blind.bench.unlisted_losses import CreepingClutch
from studies.blind.renewed.listed import ClutchSlip
from studies.blind.renewed.transmissions import LAYOUTS
from studies.blind.unknown import ClutchMicroslip

TRAINS = {train.name: (layout, train) for layout in LAYOUTS for train in layout.trains}


@pytest.mark.parametrize("kind", [ClutchSlip, CreepingClutch, ClutchMicroslip])
@pytest.mark.parametrize("name", ["HM2", "HM4"])
def test_sliding_speed_follows_the_torque_of_the_output(kind, name):
    layout, train = TRAINS[name]
    rng = np.random.default_rng(3)
    warm = np.full(300, 60.0)
    settings = Settings(
        displacement_ratio=rng.uniform(-0.9, 0.9, 300),
        engine_speed=rng.uniform(80.0, 210.0, 300),
        load_torque=rng.uniform(80.0, 400.0, 300),
        oil_temperature=warm,
        film_temperature=warm,
        approach=np.zeros(300),
    )
    state = Stand(train, layout.base, (kind(size=0.3),)).run(settings)
    assert np.sum(state.runs) > 200
    full = train.mechanical_share * settings.engine_speed
    full = full + train.motor_share * state.motor_speed
    sliding = (full - state.output_speed) / train.mechanical_share
    # Torques at a planetary row stand in a fixed ratio, whatever the speeds.
    order = np.argsort(state.output_torque[state.runs])
    sliding = sliding[state.runs][order]
    assert np.all(np.diff(sliding) > -1e-6)
    assert sliding[-1] > 0.5
