# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A mission: the fuel of a strategy over a work cycle, and how close to the best it comes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hmcvt_core.files import plain
from hmcvt_core.transmission.ranges import Array

from .bound import Bound, bound
from .cycle import Cycle
from .energy import Energy, Powers, powers
from .points import SPEED_STEP, Drive, WorkingPoints, reason, speed_grid, working_points
from .run import NOWHERE, Complaint, Run, drive_cycle
from .strategies import Strategy, strategy_named

DIESEL_DENSITY = 0.835
"""Mass of a litre of diesel [kg], the middle of EN 590 (0.820 to 0.845 at 15 deg C)."""

_SMALLEST_FRACTION = 1e-9
"""Of the engine's work: what less is needs no line in the report."""

_MAX_NAMED = 5  # complaints of one kind that the text names


@dataclass(frozen=True, eq=False)
class Mission:
    """What a strategy did over a cycle; arrays of shape (n,), NaN where nothing holds the demand.

    Attributes:
        cycle: demand.
        strategy: name, or path of a file.
        stage: engaged, `neutral` at standstill, empty where nothing holds the demand.
        engine_speed: [rad/s].
        displacement_ratio: [-]; NaN in neutral.
        fuel_rate: [kg/s]; zero where nothing holds the demand.
        powers: useful and lost, step by step.
        energy: of the cycle.
        shifts: number of stage changes.
        unmet: steps that no working point holds.
        broken: steps at which the limits of the machine could not be kept.
        replaced: choices of the strategy that were not possible.
        bound: least fuel possible, or None where it was not asked for.
        remarks: what of the cycle and of the engine map was left out or changed.
    """

    cycle: Cycle
    strategy: str
    stage: Sequence[str]
    engine_speed: Array
    displacement_ratio: Array
    fuel_rate: Array
    powers: Powers
    energy: Energy
    shifts: int
    unmet: Sequence[Complaint]
    broken: Sequence[Complaint]
    replaced: Sequence[Complaint]
    bound: Bound | None = None
    remarks: tuple[str, ...] = ()

    @property
    def fuel(self) -> float:
        """Fuel of the cycle [kg]."""
        return float(self.fuel_rate.sum()) * self.cycle.step

    @property
    def driven(self) -> int:
        """Number of steps that were driven."""
        return len(self.cycle) - len(self.unmet)

    @property
    def fuel_per_hour(self) -> float:
        """Fuel in an hour of such work [kg]; zero where no step was driven."""
        seconds = self.driven * self.cycle.step
        return 3600.0 * self.fuel / max(seconds, self.cycle.step)

    @property
    def above_bound(self) -> float | None:
        """Fuel above the least possible, as a part of that [-]; None without a bound."""
        if self.bound is None or not self.bound.fuel:
            return None
        return self.fuel / self.bound.fuel - 1.0

    def to_dict(self) -> dict[str, Any]:
        """Return the mission as plain data for JSON, energies in J."""
        least = self.bound
        return dict(
            plain(
                {
                    "cycle": self.cycle.name,
                    "strategy": self.strategy,
                    "seconds": len(self.cycle) * self.cycle.step,
                    "fuel": self.fuel,
                    "fuel_per_hour": self.fuel_per_hour,
                    "bound": None if least is None else least.fuel,
                    "bound_error": None if least is None else least.error,
                    "bound_error_by": None
                    if least is None
                    else {"grid": least.grid_error, "fuel_map": least.map_error},
                    "above_bound": self.above_bound,
                    "energy": {
                        "engine": self.energy.engine,
                        "useful": self.energy.useful,
                        "losses": self.energy.losses,
                        "lost": self.energy.lost,
                        "imbalance": self.energy.imbalance,
                    },
                    "shifts": self.shifts,
                    "unmet": [item._asdict() for item in self.unmet],
                    "broken": [item._asdict() for item in self.broken],
                    "replaced": [item._asdict() for item in self.replaced],
                    "remarks": self.remarks,
                }
            )
        )

    def series(self) -> dict[str, Any]:
        """Return columns of equal length, one row a step, in SI."""
        columns: dict[str, Any] = {
            "time": self.cycle.time,
            "output_speed": self.cycle.output_speed,
            "output_power": self.cycle.output_power,
            "pto_power": self.cycle.pto_power,
            "stage": self.stage,
            "engine_speed": self.engine_speed,
            "displacement_ratio": self.displacement_ratio,
            "fuel_rate": self.fuel_rate,
        }
        for part, watts in self.powers.losses.items():
            columns[f"loss_{part}"] = watts
        return columns

    def report(self) -> str:
        """Return the mission as text."""
        litres = self.fuel / DIESEL_DENSITY
        lines = [
            f"cycle     {self.cycle.name}, {len(self.cycle) * self.cycle.step:.0f} s",
            f"strategy  {self.strategy}",
            f"fuel      {self.fuel:.3f} kg ({litres:.2f} l), "
            f"{self.fuel_per_hour:.2f} kg/h",
        ]
        if self.bound is not None and self.above_bound is not None:
            lines.append(
                f"bound     {self.bound.fuel:.3f} kg +- {self.bound.error:.4f} kg (grid "
                f"{self.bound.grid_error:.4f}, fuel map {self.bound.map_error:.4f}): the "
                f"strategy is {_percent(self.above_bound)} above the best possible"
            )
        lines.append(f"stage changes  {self.shifts}")
        lines += _energy_lines(self.energy)
        for title, complaints in (
            ("demand not met", self.unmet),
            ("limits of the machine broken", self.broken),
            ("choices replaced", self.replaced),
        ):
            lines += _complaint_lines(title, complaints)
        lines += [f"note: {remark}" for remark in self.remarks]
        return "\n".join(lines)


def _percent(part: float) -> str:
    # Adding 0.0 turns -0.0 into 0.0.
    return f"{round(100.0 * part, 2) + 0.0:.2f} %"


def _energy_lines(energy: Energy) -> list[str]:
    lines = [f"engine work {energy.engine / 3.6e6:.2f} kWh, of it"]
    parts = [(name, joules, "") for name, joules in energy.useful.items()]
    losses = sorted(energy.losses.items(), key=lambda loss: -loss[1])
    parts += [(name, joules, "lost: ") for name, joules in losses]
    for name, joules, kind in parts:
        if abs(joules) < _SMALLEST_FRACTION * energy.engine:
            continue  # rounding of a part that takes nothing
        share = 100.0 * joules / energy.engine
        label = kind + name.replace("_", " ")
        lines.append(f"  {label:<26} {joules / 3.6e6:7.3f} kWh {share:6.1f} %")
    return lines


def _complaint_lines(title: str, complaints: Sequence[Complaint]) -> list[str]:
    if not complaints:
        return []
    lines = [f"{title} at {len(complaints)} steps:"]
    for item in complaints[:_MAX_NAMED]:
        lines.append(f"  {item.time:g} s: {item.reason}")
    if len(complaints) > _MAX_NAMED:
        lines.append(f"  and {len(complaints) - _MAX_NAMED} more")
    return lines


@dataclass(frozen=True, eq=False)
class Planned:
    """A cycle with its working points, for several strategies.

    Attributes:
        drive: the drive line.
        cycle: demand.
        points: working points.
        bound: least fuel possible, or None where it was not asked for.
    """

    drive: Drive
    cycle: Cycle
    points: WorkingPoints
    bound: Bound | None

    @classmethod
    def of(
        cls,
        drive: Drive,
        cycle: Cycle,
        with_bound: bool = True,
        speed_step: float = SPEED_STEP,
    ) -> Planned:
        """Return a cycle with its working points.

        Args:
            drive: the drive line.
            cycle: demand.
            with_bound: whether the least fuel possible is looked for.
            speed_step: distance of the engine speeds to choose from [rad/s].

        Raises:
            InputError: the limits leave no engine speed or no time for a stage change, or the
                formulation of the model is not `power_balance`.
        """
        stages = tuple(drive.model.stages)
        grid = speed_grid(
            stages, drive.engine, drive.vehicle.limits, cycle.step, speed_step
        )
        points = working_points(drive, cycle, grid)
        least = bound(drive, cycle, points) if with_bound else None
        return cls(drive, cycle, points, least)

    def mission(
        self, strategy: str | Strategy, believed: WorkingPoints | None = None
    ) -> Mission:
        """Drive the cycle with a strategy.

        Args:
            strategy: name of `STRATEGIES`, path of a Python file, or a function that takes a
                `Situation` and returns a stage and an engine speed.
            believed: working points by the model that the strategy knows; the tractor's when left
                out.

        Raises:
            InputError: there is no such strategy.
        """
        if isinstance(strategy, str):
            name = strategy
            choose = strategy_named(strategy)
        else:
            name = getattr(strategy, "__name__", type(strategy).__name__)
            choose = strategy
        run = drive_cycle(choose, self.drive, self.cycle, self.points, believed)
        return self._result(name, run)

    def best(self) -> Mission:
        """Return the mission of least fuel, which knows the cycle in advance.

        Raises:
            ValueError: the bound was not asked for.
        """
        if self.bound is None:
            raise ValueError("the bound was not asked for")
        path = self.bound.path
        broken = []
        for step in path.broken.tolist():
            broken.append(
                Complaint(float(self.cycle.time[step]), "no working point is in reach")
            )
        run = Run(path.stage, path.speed, self._changed(path.stage), broken, ())
        return self._result("bound", run)

    def _changed(self, stage: Any) -> Any:
        """Return at which steps a path changes the stage, shape (n,)."""
        before = np.concatenate([[NOWHERE], stage[:-1]])
        neutral = self.points.grid.neutral
        moving = (stage != NOWHERE) & (before != NOWHERE)
        engaged = (stage != neutral) & (before != neutral)
        return moving & engaged & (stage != before)

    def _result(self, strategy: str, run: Run) -> Mission:
        driven = run.stage != NOWHERE
        at = (np.flatnonzero(driven), run.stage[driven], run.speed[driven])
        speed = np.full(len(self.cycle), np.nan)
        stroke = speed.copy()
        speed[driven] = self.points.engine_speed[at]
        stroke[driven] = self.points.stroke[at]
        stages = []
        for position in run.stage.tolist():
            stages.append(
                "" if position == NOWHERE else self.points.grid.stages[position]
            )
        unmet = []
        for step in np.flatnonzero(~driven).tolist():
            unmet.append(
                Complaint(
                    float(self.cycle.time[step]),
                    reason(self.drive, self.cycle, self.points, step),
                )
            )
        used = powers(self.drive, self.cycle, self.points, run)
        return Mission(
            cycle=self.cycle,
            strategy=strategy,
            stage=stages,
            engine_speed=speed,
            displacement_ratio=stroke,
            fuel_rate=run.fuel(self.points),
            powers=used,
            energy=Energy.of(used, self.cycle.step),
            shifts=int(run.changed.sum()),
            unmet=unmet,
            broken=run.broken,
            replaced=run.replaced,
            bound=self.bound,
            remarks=(*self.cycle.remarks, *self.drive.engine.remarks),
        )
