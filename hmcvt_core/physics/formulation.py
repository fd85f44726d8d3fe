# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The two formulations of the efficiency: one interface, two sets of equations.

`POWER_BALANCE` is served. `PUBLISHED` reproduces the paper: eqs (4)-(18), guarded.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol

from ..errors import InputError
from ..transmission.parameters import Parameters
from ..transmission.ranges import OperatingPoints, Solution
from ..transmission.stage import Stage
from .balance import STALLED, BalanceSolver
from .effects.base import Effect
from .published import INCONSISTENT, PublishedSolver


class Solver(Protocol):
    """Equations of one stage with given parameters."""

    def solve(self, points: OperatingPoints) -> Solution:
        """Return efficiency, output speed and engine torque at n points."""

    def refusal(
        self, displacement_ratio: float, load_torque: float, engine_torque: float
    ) -> str:
        """Return why there is no efficiency at a point with this engine torque [N m]."""


class Formulation(Protocol):
    """A set of equations that predicts the efficiency of a stage."""

    @property
    def name(self) -> str:
        """The name in parameter files and arguments."""

    @property
    def no_answer(self) -> str:
        """The usual reason why there is no efficiency under load."""

    def require_valid(self, stage: Stage, effects: Sequence[Effect]) -> None:
        """Raise an `InputError` where the equations do not hold for a stage or effects."""

    def solver(
        self, stage: Stage, parameters: Parameters, effects: tuple[Effect, ...]
    ) -> Solver:
        """Return the equations of one stage with given parameters."""


class _PowerBalance:
    """The balance of powers, shaft by shaft; holds for every layout and effect."""

    name = "power_balance"
    no_answer = STALLED

    def require_valid(self, stage: Stage, effects: Sequence[Effect]) -> None:
        """Accept every stage and effect."""

    def solver(
        self, stage: Stage, parameters: Parameters, effects: tuple[Effect, ...]
    ) -> BalanceSolver:
        return BalanceSolver(stage, parameters, effects)


class _Published:
    """The formulas of the paper; NaN where they contradict themselves."""

    name = "published"
    no_answer = INCONSISTENT

    def require_valid(self, stage: Stage, effects: Sequence[Effect]) -> None:
        if stage.layout != "input_coupled" or stage.reverse:
            raise InputError(
                "the published formulas are of an input-coupled forward stage"
            )
        if effects:
            raise InputError(
                f"effects act in the power balance only, not in formulation {self.name!r}"
            )

    def solver(
        self, stage: Stage, parameters: Parameters, effects: tuple[Effect, ...]
    ) -> PublishedSolver:
        return PublishedSolver(stage, parameters)


POWER_BALANCE: Formulation = _PowerBalance()
PUBLISHED: Formulation = _Published()
FORMULATIONS: Mapping[str, Formulation] = {
    formulation.name: formulation for formulation in (POWER_BALANCE, PUBLISHED)
}


def formulation_named(name: str) -> Formulation:
    """Return the formulation of a name.

    Raises:
        InputError: there is no such formulation.
    """
    # A file may hold anything under this key, unhashable values included.
    if not isinstance(name, str) or name not in FORMULATIONS:
        raise InputError(f"formulation = {name!r}; there is {', '.join(FORMULATIONS)}")
    return FORMULATIONS[name]
