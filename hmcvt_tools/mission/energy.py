# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Where the engine's work goes: useful power, and the loss of each part, step by step.

The engine's power comes from the working points, the losses from the balance of the transmission at
the same points. That both agree is a check of either.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.transmission.ranges import Array

from .cycle import Cycle
from .points import Drive, WorkingPoints, idle_stage
from .run import NOWHERE, Run

USEFUL_AT_GROUND = ("drawbar", "acceleration", "slope")
"""Powers at the ground that are no losses; the last two return as the tractor slows or descends."""

_GEAR_PAIR = "gear_pair_"


@dataclass(frozen=True, eq=False)
class Powers:
    """Powers of a run, shape (n,) each [W]; zero where nothing holds the demand.

    Attributes:
        engine: what the engine gives.
        useful: by kind: `output`, or `drawbar`, `acceleration` and `slope`; `pto`, `auxiliary`.
        losses: by part: as of `Breakdown`, with the gear pairs as one; `stage_changes`,
            `pto_drive`, and at the ground `final_drive`, `wheel_slip`, `rolling_resistance`,
            `brakes`.
    """

    engine: Array
    useful: Mapping[str, Array]
    losses: Mapping[str, Array]


@dataclass(frozen=True)
class Energy:
    """Energies of a run [J].

    Attributes:
        engine: work of the engine.
        useful: by kind, as of `Powers`.
        losses: by part, as of `Powers`.
    """

    engine: float
    useful: Mapping[str, float]
    losses: Mapping[str, float]

    @property
    def lost(self) -> float:
        """Sum of the losses [J]."""
        return sum(self.losses.values())

    @property
    def imbalance(self) -> float:
        """Engine work less useful work and losses, as a part of the engine work [-]."""
        if not self.engine:
            return 0.0
        rest = self.engine - sum(self.useful.values()) - self.lost
        return rest / self.engine

    @classmethod
    def of(cls, powers: Powers, step: float) -> Energy:
        """Return the energies of powers that hold for a step each [s]."""
        return cls(
            float(powers.engine.sum()) * step,
            _energies(powers.useful, step),
            _energies(powers.losses, step),
        )


def _energies(powers: Mapping[str, Array], step: float) -> dict[str, float]:
    return {name: float(watts.sum()) * step for name, watts in powers.items()}


def powers(drive: Drive, cycle: Cycle, points: WorkingPoints, run: Run) -> Powers:
    """Return the powers of a run.

    Args:
        drive: the drive line.
        cycle: demand.
        points: working points of the tractor.
        run: what a strategy did.
    """
    driven = run.stage != NOWHERE
    at = (np.flatnonzero(driven), run.stage[driven], run.speed[driven])
    speed = points.engine_speed[at]
    change = np.where(run.changed[driven], drive.vehicle.limits.stage_change_loss, 0.0)
    change_power = change / cycle.step
    engine = points.engine_torque[at] * speed + change_power
    pto = cycle.pto_power[driven]
    useful: dict[str, Array] = {}
    losses = _transmission_losses(drive.model, points, run, cycle)
    losses["stage_changes"] = change_power
    losses["pto_drive"] = pto / drive.vehicle.pto_efficiency - pto
    if not cycle.ground:
        useful["output"] = cycle.output_power[driven]
    for name, watts in cycle.ground.items():
        target = useful if name in USEFUL_AT_GROUND else losses
        target[name] = watts[driven]
    useful["pto"] = pto
    useful["auxiliary"] = cycle.auxiliary_power[driven]
    return Powers(
        _spread(engine, driven),
        {name: _spread(watts, driven) for name, watts in useful.items()},
        {name: _spread(watts, driven) for name, watts in losses.items()},
    )


def _spread(values: Array, driven: Array) -> Array:
    """Return values of the driven steps at all steps, zero elsewhere."""
    spread = np.zeros(len(driven))
    spread[driven] = values
    return spread


def _transmission_losses(
    model: EfficiencyModel, points: WorkingPoints, run: Run, cycle: Cycle
) -> dict[str, Array]:
    """Return the losses of the transmission by part at the driven steps [W]."""
    driven = np.flatnonzero(run.stage != NOWHERE)
    losses: dict[str, Array] = {}
    for position, name in enumerate(points.grid.stages):
        (rows,) = np.nonzero(run.stage[driven] == position)
        if not len(rows):
            continue
        steps = driven[rows]
        at = (steps, position, run.speed[steps])
        speed = points.engine_speed[at]
        stroke = points.stroke[at]
        load = cycle.output_power[steps] / speed
        stage = name
        if position == points.grid.neutral:
            stage = idle_stage(model)
            stroke = np.zeros(len(rows))
        breakdown = model.breakdown(stroke, speed, load, stage=stage)
        for part, watts in breakdown.losses.items():
            key = "gear_pairs" if part.startswith(_GEAR_PAIR) else part
            lost = losses.setdefault(key, np.zeros(len(driven)))
            lost[rows] += watts
    return losses
