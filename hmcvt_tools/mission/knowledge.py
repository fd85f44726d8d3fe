# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What knowledge of the transmission is worth, in fuel.

A strategy that believes another model chooses other working points. The tractor then needs more
fuel than it would with a strategy that knows it, and than the model says.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hmcvt_core.files import plain
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.transmission.ranges import RPM
from hmcvt_core.transmission.stage import Stage

from .cycle import Cycle
from .points import Drive
from .result import DIESEL_DENSITY, Planned

SPEED_STEP = 40.0 * RPM
"""Distance of engine speeds [rad/s]: enough for differences of fuel, and quick with effects."""

_SAME_LOSS = 1e-9
"""Difference of two gear losses that is rounding [-]."""


@dataclass(frozen=True)
class Worth:
    """Fuel of the same work with and without knowledge of the transmission [kg/h].

    Attributes:
        cycle: name of the cycle.
        expected: fuel of its choices by the model that it assumes.
        needed: what the tractor needs with these choices.
        informed: what the tractor needs with the choices of a strategy that knows it.
        unmet: steps that the tractor cannot drive, whatever is chosen.
        steps: of the cycle.
    """

    cycle: str
    expected: float
    needed: float
    informed: float
    unmet: int
    steps: int

    @property
    def gap(self) -> float:
        """Fuel beyond what the assumed model expects [kg/h]."""
        return self.needed - self.expected

    @property
    def saving(self) -> float:
        """Fuel that knowing the transmission saves [kg/h]."""
        return self.needed - self.informed

    @property
    def lost_part(self) -> float:
        """Fuel lost without the knowledge, as a part of what is needed with it [-]."""
        return self.saving / self.informed if self.informed else 0.0

    def to_dict(self) -> dict[str, Any]:
        """Return the fuel as plain data for JSON, in kg/h and l/h."""
        return dict(
            plain(
                {
                    **vars(self),
                    "gap": self.gap,
                    "saving": self.saving,
                    "gap_litres": self.gap / DIESEL_DENSITY,
                    "saving_litres": self.saving / DIESEL_DENSITY,
                }
            )
        )

    def report(self) -> str:
        """Return the fuel as text."""
        lines = [
            f"On the cycle {self.cycle} the tractor needs {_in_litres(self.gap, 2)} than the model "
            f"says ({self.gap:+.3f} kg/h, {100.0 * self.gap / self.expected:+.1f} %).",
            "With the cause in the model, the choices of the strategy need "
            f"{_in_litres(-self.saving, 3)} ({-100.0 * self.lost_part:+.2f} % of the fuel).",
        ]
        if self.unmet:
            lines.append(
                f"{self.unmet} of {self.steps} steps cannot be driven and do not count."
            )
        return "\n".join(lines)


def _in_litres(change: float, digits: int) -> str:
    """Return a change of the fuel in words, such as `0.17 l/h more`.

    Args:
        change: [kg/h].
        digits: behind the point.
    """
    more = "less" if change < 0.0 else "more"
    return f"{abs(change) / DIESEL_DENSITY:.{digits}f} l/h {more}"


def worth(
    truth: Drive, believed: EfficiencyModel, cycle: Cycle, strategy: str = "causal"
) -> Worth:
    """Return the fuel of a cycle with and without knowledge of the transmission.

    Args:
        truth: the drive line as it is.
        believed: the model that the strategy without the knowledge has.
        cycle: demand.
        strategy: as of `Planned.mission`.

    Raises:
        InputError: as of `Planned.of`.
    """
    tractor = Planned.of(truth, cycle, False, SPEED_STEP)
    model = Planned.of(truth._replace(model=believed), cycle, False, SPEED_STEP)
    informed = tractor.mission(strategy)
    needed = tractor.mission(strategy, model.points)
    return Worth(
        cycle=cycle.name,
        expected=model.mission(strategy).fuel_per_hour,
        needed=needed.fuel_per_hour,
        informed=informed.fuel_per_hour,
        unmet=len(informed.unmet),
        steps=len(cycle),
    )


def in_transmission(
    model: EfficiencyModel, transmission: EfficiencyModel
) -> EfficiencyModel:
    """Return a transmission with parameters and effects of a model of one of its stages.

    The stages of a transmission share pump and motor, and their gear pairs are made alike: a
    further gear loss that a diagnosis fitted holds in all of them. A model that is of several
    stages, or of a stage that the transmission does not have, is returned as it is.

    Args:
        model: of a bench.
        transmission: with all stages.
    """
    if len(model.stages) > 1:
        return model
    for part in transmission.stages.values():
        loss = _further_gear_loss(model.stage, part.stage)
        if loss is None:
            continue
        return replace(
            transmission,
            stage=transmission.stage.with_gear_loss(loss),
            other_stages=tuple(
                stage.with_gear_loss(loss) for stage in transmission.other_stages
            ),
            parameters=model.parameters,
            effects=model.effects,
            domain=None,
        ).with_errors({}, None)
    return model


def _further_gear_loss(stage: Stage, reference: Stage) -> float | None:
    """Return the part of the power that every gear pair loses more than in a reference [-].

    None where the stages differ in anything but that, and the open clutches, which a file of one
    stage does not state.
    """
    if _without_losses(stage) != _without_losses(reference):
        return None
    losses = []
    for pair, as_listed in zip(stage.gear_pairs, reference.gear_pairs, strict=True):
        losses.append(1.0 - pair.efficiency / as_listed.efficiency)
    loss = float(np.median(losses)) if losses else 0.0
    if not np.allclose(losses, loss, rtol=0.0, atol=_SAME_LOSS):
        return None
    return loss


def _without_losses(stage: Stage) -> Stage:
    return replace(stage.with_gear_efficiency(1.0), open_clutches=())
