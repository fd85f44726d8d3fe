# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The efficiency model: what users hold in their hands."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..files import picture, preformatted
from ..files.bench import BenchSamples
from ..physics.balance import BalanceSolver, Breakdown
from ..physics.effects import effect_to_mapping
from ..physics.effects.base import Effect
from ..physics.published import PublishedSolver
from ..physics.single_point import Point
from ..transmission import ranges
from ..transmission.parameters import (
    PARAMETER_RANGES,
    Candidates,
    HydraulicParameters,
    Parameters,
)
from ..transmission.ranges import Array, OperatingPoints, Solution
from ..transmission.stage import Stage, stages_to_mapping
from .domain import AXES, Domain, EfficiencyMap, Prediction
from .engine import Engine
from .optimum import DriveOptimum, Optimum, drive_optimum, optimum

SCHEMA = "hmcvt-model/1"
FORMULATIONS = ("power_balance", "published")
_SLOW, _FAST = ranges.ENGINE_SPEED.low, ranges.ENGINE_SPEED.high
_OVERRUN, _PULL = ranges.ANY_LOAD.low, ranges.ANY_LOAD.high

STALLED = "the load cannot be carried: the leakage takes the whole flow of the pump"
BEYOND_POLE = (
    "the displacement ratio is beyond the pole of eq. (5): the row feeds more flow back to the "
    "pump than the motor takes, and no speed settles"
)
SELF_LOCKING = (
    "the stage is self-locking: without load no turning output balances its losses"
)
HELD_OUTPUT = (
    "friction holds the output at rest at this displacement ratio: it carries no load, and the "
    "sense in which wheels would turn it is not determined"
)
HELD_PUMP = (
    "in overrun the row brings the pump to rest, where its friction changes direction: the "
    "model has no answer in this strip"
)
DRAGGED = "in overrun the wheels give less than the losses take, and the engine gives the rest"
NO_OPTIMUM = (
    "formulation 'published' has no optimum: it has a pole, eq. (11), and "
    "peaks where eq. (8) alone sees no hydraulic power; take power_balance"
)
INCONSISTENT = (
    "the published formulas contradict themselves here (pole of eq. (11), "
    "or an efficiency outside 0 to 1)"
)


@dataclass(frozen=True, eq=False)
class EfficiencyModel:
    """Efficiency of one stage at any operating point, or of all stages of a transmission.

    A model of several stages answers for `stage`, the first of its file; `stages` holds each as a
    model of its own. They share pump and motor, and so the parameters.

    Angular speeds in rad/s, torques in N m; `load_torque` is referred to the engine shaft (output
    power / engine speed). Every method takes floats or arrays that broadcast, and gives floats for
    floats.

    In a model of several stages `stage` names the one engaged, for each point or for all.

    Input outside the ranges of `hmcvt_core.ranges` raises `InputError`. NaN means that the
    formulation has no answer at a permitted point; `refusal` says why.

    A model whose effects hold an error of a meter (component `sensor`) predicts what that bench
    reads: `efficiency`, `output_speed` and `predict`. Its optimum, map and breakdown are those of
    the transmission, `without_meters()`, and so is what is served.

    Attributes:
        stage: gear train and pump-motor pair.
        other_stages: of the same transmission.
        parameters: the hydraulic parameters.
        formulation: `power_balance` (served) or `published` (the paper's formulas, guarded).
        effects: what acts besides (power balance only).
        standard_errors: of the parameters by name; empty when unknown.
        correlation: of the parameters, shape (3, 3), or None.
        domain: box of the identification data, or None.
        provenance: where the parameters come from.
    """

    stage: Stage
    parameters: HydraulicParameters
    formulation: str = "power_balance"
    effects: tuple[Effect, ...] = ()
    standard_errors: Mapping[str, float] = field(default_factory=dict)
    correlation: Array | None = None
    domain: Domain | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)
    other_stages: tuple[Stage, ...] = ()

    def __post_init__(self) -> None:
        if self.formulation not in FORMULATIONS:
            raise InputError(
                f"formulation = {self.formulation!r}; there is "
                f"{', '.join(FORMULATIONS)}"
            )
        if self.formulation == "published" and (
            self.stage.layout != "input_coupled" or self.stage.reverse
        ):
            raise InputError(
                "the published formulas are of an input-coupled forward stage"
            )
        if self.effects and self.formulation != "power_balance":
            raise InputError(
                "effects act in the power balance only, "
                f"not in formulation {self.formulation!r}"
            )

    def __getstate__(self) -> dict[str, Any]:
        return {
            item.name: getattr(self, item.name) for item in fields(self)
        }  # no caches

    @cached_property
    def stages(self) -> Mapping[str, EfficiencyModel]:
        """A model of each stage by its name, in the order of the file."""
        return {
            stage.name: replace(self, stage=stage, other_stages=())
            for stage in (self.stage, *self.other_stages)
        }

    def in_stage(self, name: str | None) -> EfficiencyModel:
        """Return the model of one stage, itself for None; `InputError` where there is none such."""
        if name is None:
            return self
        if name not in self.stages:
            raise InputError(
                f"stage {name!r} is not known to the model; there is "
                f"{', '.join(self.stages)}"
            )
        return self.stages[name]

    @cached_property
    def _at_point(self) -> Callable[[float, float, float], Point] | None:
        return (
            self._solver.at_point if isinstance(self._solver, BalanceSolver) else None
        )

    @cached_property
    def _solver(self) -> BalanceSolver | PublishedSolver:
        return self._solver_of(self.parameters)

    def _solver_of(self, parameters: Parameters) -> BalanceSolver | PublishedSolver:
        return (
            BalanceSolver(self.stage, parameters, self.effects)
            if self.formulation == "power_balance"
            else PublishedSolver(self.stage, parameters)
        )

    def balance(self, refusal: str) -> BalanceSolver:
        """What solves the power balance; an `InputError` with this text where `published` does."""
        if isinstance(self._solver, PublishedSolver):
            raise InputError(refusal)
        return self._solver

    def without_meters(self) -> EfficiencyModel:
        """Return the model of the transmission alone, without errors of the bench's meters."""
        physical = tuple(
            effect for effect in self.effects if effect.component != "sensor"
        )
        return (
            self
            if len(physical) == len(self.effects)
            else replace(self, effects=physical)
        )

    # --- values -------------------------------------------------------------------------------

    def efficiency(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
        stage: ArrayLike | None = None,
    ) -> Any:
        """Efficiency that a bench reads [-]; see the class for units, shapes and errors."""
        return self._answer(
            displacement_ratio, engine_speed, load_torque, oil_temperature, stage
        )[0]

    def output_speed(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
        stage: ArrayLike | None = None,
    ) -> Any:
        """Speed of the output shaft with slip [rad/s] (`published`: without slip, eq. (5))."""
        return self._answer(
            displacement_ratio, engine_speed, load_torque, oil_temperature, stage
        )[1]

    def _answer(
        self,
        displacement_ratio: Any,
        engine_speed: Any,
        load_torque: Any,
        oil_temperature: Any,
        stage: Any,
    ) -> Sequence[Any]:
        # What a control loop asks for at every message, without the cost of arrays.
        if (
            oil_temperature is None
            and stage is None
            and type(displacement_ratio)
            is type(engine_speed)
            is type(load_torque)
            is float
            and -1.0 <= displacement_ratio <= 1.0
            and _SLOW <= engine_speed <= _FAST
            and _OVERRUN <= load_torque <= _PULL
            and (at_point := self._at_point) is not None
        ):
            return at_point(displacement_ratio, engine_speed, load_torque)
        points = OperatingPoints.checked(
            (displacement_ratio, engine_speed, load_torque), oil_temperature, stage
        )
        return [*map(_plain, self.solution_at(points))]

    def predict(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
        stage: ArrayLike | None = None,
    ) -> Prediction:
        """Efficiency with its standard error, and whether the point was covered by the data."""
        point = displacement_ratio, engine_speed, load_torque
        here, slopes = self.sensitivity(*point, oil_temperature, stage)
        correlation = np.zeros((0, 0)) if self.correlation is None else self.correlation
        variance = ((slopes @ correlation) * slopes).sum(axis=-1)
        # `published` takes a fixed eta_H at eps = 0: its parameters say nothing there.
        error = np.where(
            slopes.any(axis=-1), np.sqrt(np.maximum(variance, 0.0)), np.nan
        )
        inside = np.zeros(error.shape, dtype=bool)
        if self.domain is not None:
            inside = inside | self.domain.contains(*point)
        return Prediction(*map(_plain, (here, error, inside)))

    def sensitivity(self, *point: Any) -> tuple[Any, Array]:
        """Efficiency, and its change by one standard error of each parameter, shape (..., 3).

        The point is given as for `efficiency`; the shape is (..., 0) where errors are not known.
        """
        here = self.efficiency(*point)
        slopes = np.empty((*np.shape(here), len(self._neighbours)))
        for i, (steps, model) in enumerate(self._neighbours):
            slopes[..., i] = (model.efficiency(*point) - here) * steps
        return here, slopes

    @cached_property
    def _neighbours(self) -> list[tuple[float, EfficiencyModel]]:
        """Models that are off by a step of one parameter, and its standard error in such steps."""
        if not self.standard_errors or self.correlation is None:
            return []
        base = self.parameters.to_array()
        errors = np.array(Candidates(**self.standard_errors))
        # A step of a thousandth of the error stays in the linear range, also next to a bound.
        steps = np.maximum(1e-3 * errors, 1e-6 * base + 1e-18)
        steps = np.where(
            base + steps <= [each.high for each in PARAMETER_RANGES], steps, -steps
        )
        return [
            (count, replace(self, parameters=HydraulicParameters(*values)))
            for count, values in zip(
                (errors / steps).tolist(), (base + np.diag(steps)).tolist(), strict=True
            )
        ]

    def power_loss(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
        stage: ArrayLike | None = None,
    ) -> Any:
        """Engine power less output power [W], at any load: zero and overrun (negative) included."""
        torque = self.without_meters()._answer(
            displacement_ratio, engine_speed, load_torque, oil_temperature, stage
        )[2]
        return _plain(np.multiply(engine_speed, np.subtract(torque, load_torque)))

    def refusal(
        self,
        displacement_ratio: float,
        engine_speed: float,
        load_torque: float,
        oil_temperature: float | None = None,
        stage: str | None = None,
    ) -> str | None:
        """Say why the model has no answer at a point, or None where it has one."""
        efficiency, _, torque = self._answer(
            displacement_ratio, engine_speed, load_torque, oil_temperature, stage
        )
        if np.isfinite(efficiency).all():
            return None
        if isinstance(self._solver, PublishedSolver):
            return INCONSISTENT
        if np.isfinite(torque).all():
            return DRAGGED
        solver = self.in_stage(stage)._solver
        if isinstance(solver, BalanceSolver):
            if solver.beyond_pole(np.array(displacement_ratio)).any():
                return BEYOND_POLE
            if solver.stage.layout == "output_coupled":
                return _reason_on_row(solver, displacement_ratio, load_torque)
        return STALLED

    def breakdown(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
        stage: str | None = None,
    ) -> Breakdown:
        """Watts lost in each part.

        Raises:
            InputError: the formulation is not `power_balance`.
        """
        solver = (
            self.without_meters()
            .in_stage(stage)
            .balance("a breakdown of watts needs formulation power_balance")
        )
        points = OperatingPoints.checked(
            (displacement_ratio, engine_speed, load_torque), oil_temperature
        )
        found = solver.breakdown(points.map(np.ravel))
        into, out, *watts = (
            _plain(values.reshape(points.engine_speed.shape))
            for values in (
                found.input_power,
                found.output_power,
                *found.losses.values(),
            )
        )
        return Breakdown(into, out, dict(zip(found.losses, watts, strict=True)))

    def optimal_displacement_ratio(
        self,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        *,
        hold: str = "engine_speed",
        displacement_ratio: ArrayLike | None = None,
        output_speed: ArrayLike | None = None,
        engine_speed_limits: tuple[float, float] = ranges.ENGINE_SPEED_LIMITS,
    ) -> Optimum:
        """Displacement ratio (and engine speed) that wastes least.

        Args:
            engine_speed: now [rad/s].
            load_torque: now, output power / engine speed [N m]; broadcasts with the rest.
            hold: `engine_speed`, or `output_speed` to look for the best pair (engine speed,
                displacement ratio) that keeps output speed and output power.
            displacement_ratio: now [-]; tells the output speed to hold when that is not given.
            output_speed: to hold [rad/s].
            engine_speed_limits: lowest and highest engine speed allowed [rad/s].

        Returns:
            The best point, NaN where the model has no answer anywhere on the line.

        Raises:
            InputError: input out of range, `hold` unknown, nothing tells the output speed, or the
                formulation is `published`, whose best point is one of its own making.
        """
        model = self.without_meters()
        return optimum(
            model.balance(NO_OPTIMUM),
            engine_speed,
            load_torque,
            hold,
            displacement_ratio,
            output_speed,
            engine_speed_limits,
        )

    def optimal_drive(
        self,
        output_speed: float,
        output_power: float,
        *,
        engine: Engine | None = None,
        engine_speed_limits: tuple[float, float] = ranges.ENGINE_SPEED_LIMITS,
        torque_reserve: float = 0.0,
        stage: str | None = None,
        hysteresis: float = 0.0,
    ) -> DriveOptimum:
        """Stage, engine speed and displacement ratio of least fuel; see `drive_optimum`."""
        stages = {
            name: each.balance(NO_OPTIMUM)
            for name, each in self.without_meters().stages.items()
        }
        return drive_optimum(
            stages,
            output_speed,
            output_power,
            engine,
            engine_speed_limits,
            torque_reserve,
            stage,
            hysteresis,
        )

    def efficiency_map(
        self,
        displacement_ratios: ArrayLike,
        engine_speeds: ArrayLike,
        load_torques: ArrayLike,
    ) -> EfficiencyMap:
        """Efficiency on a grid.

        Raises:
            InputError: an axis is empty, not of shape (n,) or out of range.
        """
        axes = [
            np.atleast_1d(np.asarray(axis, dtype=float))
            for axis in (displacement_ratios, engine_speeds, load_torques)
        ]
        for name, axis in zip(AXES, axes, strict=True):
            if axis.ndim != 1 or axis.size == 0:
                raise InputError(
                    f"map axis {name} has shape {axis.shape}; needs (n,) with n > 0"
                )
        grid = np.meshgrid(*axes, indexing="ij", sparse=True)
        return EfficiencyMap(
            axes[0],
            axes[1],
            axes[2],
            self.without_meters().efficiency(*grid),
            None if self.domain is None else self.domain.contains(*grid),
        )

    # --- the same for points already checked ----------------------------------------------------

    def solution_at(self, points: OperatingPoints) -> Solution:
        """Efficiency, output speed and engine torque at checked points of one shape."""
        return Solution(
            *points.solved(lambda name, at: self.in_stage(name)._solver.solve(at))
        )

    def readings_at(self, points: OperatingPoints) -> Array:
        """Efficiency, output speed and pressure over the motor [Pa] at checked points, (3, ...).

        Raises:
            InputError: the formulation is not `power_balance`.
        """
        refusal = "a pressure needs formulation power_balance"
        return points.solved(
            lambda name, at: self.in_stage(name).balance(refusal).readings(at)[:3]
        )

    def efficiency_of_candidates(self, values: Array, points: OperatingPoints) -> Array:
        """Efficiency with other parameters than the model's own, for many candidates at once [-].

        Args:
            values: (leakage, f_m, f_p) of each candidate, shape (..., 3), SI units, unchecked.
            points: checked points of shape (n,).

        Returns:
            Shape (..., n); NaN where the formulation has no answer.
        """
        rows = values.reshape(-1, values.shape[-1])

        def solve(name: str | None, at: OperatingPoints) -> list[Array]:
            part = max(1, ranges.CHUNK // max(1, at.engine_speed.size))
            solvers = (
                self.in_stage(name)._solver_of(
                    Candidates(*rows[i : i + part].T[:, :, None])
                )
                for i in range(0, len(rows), part)
            )
            return [np.concatenate([solver.solve(at).efficiency for solver in solvers])]

        return points.solved(solve)[0].reshape(*values.shape[:-1], -1)

    # --- the model as data ----------------------------------------------------------------------

    def to_mapping(self) -> dict[str, Any]:
        """Return plain data, as a parameter file holds it: strings, numbers, lists, mappings."""
        data: dict[str, Any] = {
            "schema": SCHEMA,
            "formulation": self.formulation,
            "parameters": self.parameters.to_mapping(self.standard_errors),
        }
        if self.correlation is not None:
            data["correlation"] = np.asarray(self.correlation).round(6).tolist()
        if self.effects:
            data["effects"] = [effect_to_mapping(effect) for effect in self.effects]
        if self.domain is not None:
            data["domain"] = self.domain.to_mapping()
        data["provenance"] = dict(self.provenance)
        data["transmission"] = stages_to_mapping((self.stage, *self.other_stages))
        return data

    @cached_property
    def fingerprint(self) -> str:
        """Twelve hexadecimal digits that change when the physics changes, not the provenance."""
        physics = {
            name: value
            for name, value in self.to_mapping().items()
            if name in ("formulation", "transmission", "effects")
        }
        physics["parameters"] = self.parameters.to_array().tolist()
        text = json.dumps(physics, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def plot_map(self, power: float = 40e3, samples: BenchSamples | None = None) -> Any:
        """Return a matplotlib figure of the efficiency at an output power [W], tests marked."""
        return picture(self, power, samples=samples)

    def _repr_html_(self) -> str:
        values = self.parameters.to_mapping(self.standard_errors).items()
        return preformatted(
            "\n".join(
                [
                    self.formulation,
                    *(
                        f"  {name:<14} {entry['value']:.4g} {entry['unit']}"
                        for name, entry in values
                    ),
                ]
            )
        )


def _reason_on_row(
    solver: BalanceSolver, displacement_ratio: float, load_torque: float
) -> str:
    """Say why an output-coupled stage has no answer at a point before the pole."""
    # Where friction holds the output depends on the displacement ratio alone.
    columns = np.array([[displacement_ratio], [1.0], [load_torque]], dtype=float)
    resting = solver.resting(OperatingPoints(*columns))
    if resting is not None:
        return HELD_OUTPUT
    if load_torque == 0.0:
        return SELF_LOCKING
    return HELD_PUMP if load_torque < 0.0 else STALLED


def _plain(values: Any) -> Any:
    """Return a plain number for an array without a dimension."""
    return values if np.ndim(values) else np.asarray(values).item()
