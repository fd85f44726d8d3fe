# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Figures 3 to 5: efficiency over engine speed and transmission ratio at a load power."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.physics import published
from hmcvt_core.transmission.ranges import RPM, OperatingPoints
from hmcvt_core.transmission.stage import speed_ratio

from . import paper
from .item import NOT_REPRODUCIBLE, Item, claim
from .tables import FORMULATIONS, Fit

Array = NDArray[np.float64]
GROUP = "Figures 3 to 5: efficiency at 40, 60 and 80 kW"
_SPEEDS, _STROKES = 117, 160  # even: eps = 0, a convention, stays out of the grid


@dataclass(frozen=True, eq=False)
class Surface:
    """One formulation at one load power; arrays of shape (strokes, speeds).

    Attributes:
        figure: number in the paper.
        formulation: of the model.
        load_power: [W].
        engine_speed: [rad/s].
        speed_ratio: output / engine speed without slip, eq. (5) [-].
        displacement_ratio: [-].
        efficiency: as served; NaN where the formulation has no answer [-].
        bare: as served, but `published` without its guard, through its poles [-].
        denominator: that of (11), 0 at a pole; None for `power_balance`.
    """

    figure: int
    formulation: str
    load_power: float
    engine_speed: Array
    speed_ratio: Array
    displacement_ratio: Array
    efficiency: Array
    bare: Array
    denominator: Array | None

    @property
    def refused(self) -> float:
        """Fraction of the range without an answer."""
        return float(np.isnan(self.efficiency).mean())


def surfaces(fits: dict[tuple[str, float], Fit]) -> list[Surface]:
    """Both formulations, identified on five tests, at the three load powers."""
    models = {
        name: fits[name, paper.BEST_GEAR_EFFICIENCY].identification.model
        for name in FORMULATIONS
    }
    return [
        _surface(figure, power, models[name])
        for figure, power in paper.LOAD_POWERS.items()
        for name in reversed(FORMULATIONS)
    ]


def _surface(figure: int, power: float, model: EfficiencyModel) -> Surface:
    speed = np.linspace(*paper.ENGINE_SPEEDS, _SPEEDS) * RPM
    stroke, speed = np.meshgrid(np.linspace(-1.0, 1.0, _STROKES), speed, indexing="ij")
    points = OperatingPoints(stroke, speed, power / speed)
    served = bare = model.solution_at(points).efficiency
    denominator = None
    if model.formulation == "published":
        with np.errstate(divide="ignore", invalid="ignore"):
            hydraulic = published.hydraulic_efficiency(
                model.stage, model.parameters, points
            )
            values = published.efficiencies(model.stage, stroke, hydraulic)
            bare, denominator = values.total, values.split_ratio / values.engine_share
    return Surface(
        figure,
        model.formulation,
        power,
        speed,
        speed_ratio(model.stage, stroke),
        stroke,
        served,
        bare,
        denominator,
    )


def items(found: list[Surface]) -> list[Item]:
    """What can be said of surfaces printed without numbers."""
    return [item for surface in found for item in _items(surface)]


def _items(surface: Surface) -> list[Item]:
    what = f"figure {surface.figure}, {1e-3 * surface.load_power:g} kW, {surface.formulation}"
    best, worst = (
        100.0 * float(pick(surface.efficiency)) for pick in (np.nanmax, np.nanmin)
    )
    ours = f"{worst:.1f} to {best:.1f} %, no answer on {100.0 * surface.refused:.0f} %"
    if surface.formulation == "power_balance":
        return [
            Item(
                GROUP,
                what,
                "a surface without numbers",
                ours,
                NOT_REPRODUCIBLE,
                "the paper prints no values of its surfaces; ours is drawn for the eye",
            )
        ]
    beyond = float((np.abs(surface.bare) > 1.0).mean())
    return [
        claim(
            GROUP,
            what,
            "a surface without gaps",
            ours,
            surface.refused == 0.0,
            why=f"(11) has a pole in the range: unguarded, {100.0 * beyond:.1f} % of it lies "
            "above 100 % or below -100 %; masked where the formulas contradict themselves",
        )
    ]
