# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The efficiency model: what users hold in their hands."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..physics.balance import BalanceSolver, Breakdown
from ..physics.effects import effect_to_mapping
from ..physics.effects.base import Effect
from ..physics.published import PublishedSolver
from ..physics.steady_state import ArraySolver, PointSolver
from ..transmission.parameters import (
    PARAMETER_NAMES,
    PARAMETER_RANGES,
    PARAMETER_UNITS,
    Candidates,
    HydraulicParameters,
    Parameters,
)
from ..transmission.ranges import ENGINE_SPEED_LIMITS, Answer, OperatingPoints, is_plain
from ..transmission.stage import Stage
from .domain import AXES, Domain, EfficiencyMap
from .optimum import Optimum, optimum

Array = NDArray[np.float64]
SCHEMA = "hmcvt-model/1"
FORMULATIONS = ("power_balance", "published")

STALLED = "the load cannot be carried: the leakage takes the whole flow of the pump"
NO_OPTIMUM = ("formulation 'published' has no optimum: it has a pole, eq. (11), and "
              "peaks where eq. (8) alone sees no hydraulic power; take power_balance")
INCONSISTENT = ("the published formulas contradict themselves here (pole of eq. (11), "
                "or an efficiency outside 0 to 1)")
_CHUNK = 8192
"""Values worked out at a time: their arrays stay in the cache of the processor."""


class Prediction(NamedTuple):
    """What the model says at operating points; floats, or arrays of one shape.

    Attributes:
        efficiency: output power / engine power [-]; NaN where the model has no answer.
        standard_error: from the covariance of the parameters [-]; NaN where none is known.
        inside_domain: whether the point lies in the box of the identification data.
    """

    efficiency: Any
    standard_error: Any
    inside_domain: Any


@dataclass(frozen=True, eq=False)
class EfficiencyModel:
    """Efficiency of one stage at any operating point.

    Angular speeds in rad/s, torques in N m; `load_torque` is referred to the engine shaft (output
    power / engine speed). Every method takes floats or arrays that broadcast, and gives floats for
    floats.

    Input outside the ranges of `hmcvt_core.ranges` raises `InputError`. NaN means that the
    formulation has no answer at a permitted point; `refusal` says why.

    A model whose effects hold an error of a meter (component `sensor`) predicts what that bench
    reads: `efficiency`, `output_speed` and `predict`. Its optimum, map and breakdown are those of
    the transmission, `without_meters()`, and so is what is served.

    Attributes:
        stage: gear train and pump-motor pair.
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

    def __post_init__(self) -> None:
        if self.formulation not in FORMULATIONS:
            raise InputError(f"formulation = {self.formulation!r}; there is "
                             f"{', '.join(FORMULATIONS)}")
        if self.effects and self.formulation != "power_balance":
            raise InputError("effects act in the power balance only, "
                             f"not in formulation {self.formulation!r}")

    @cached_property
    def _point_solver(self) -> PointSolver | None:
        """What answers single points in a microsecond, where the formulation allows it."""
        exact = self.formulation == "power_balance" and not self.effects
        return PointSolver(self.stage, self.parameters) if exact else None

    @cached_property
    def _solver(self) -> ArraySolver | PublishedSolver:
        return self._solver_of(self.parameters)

    def _solver_of(self, parameters: Parameters) -> ArraySolver | PublishedSolver:
        if self.formulation == "published":
            return PublishedSolver(self.stage, parameters)
        if self.effects:
            return BalanceSolver(self.stage, parameters, self.effects)
        return ArraySolver(self.stage, parameters)

    def without_meters(self) -> EfficiencyModel:
        """Return the model of the transmission alone, without errors of the bench's meters."""
        physical = tuple(effect for effect in self.effects if effect.component != "sensor")
        return self if len(physical) == len(self.effects) else replace(self, effects=physical)

    # --- values -------------------------------------------------------------------------------

    def efficiency(
        self, displacement_ratio: ArrayLike, engine_speed: ArrayLike, load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
    ) -> Any:
        """Efficiency that a bench reads [-]; see the class for units, shapes and errors."""
        return self._answer((displacement_ratio, engine_speed, load_torque), oil_temperature)[0]

    def output_speed(
        self, displacement_ratio: ArrayLike, engine_speed: ArrayLike, load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
    ) -> Any:
        """Speed of the output shaft with slip [rad/s] (`published`: without slip, eq. (5))."""
        return self._answer((displacement_ratio, engine_speed, load_torque), oil_temperature)[1]

    def _answer(
        self, point: tuple[ArrayLike, ArrayLike, ArrayLike], oil_temperature: ArrayLike | None
    ) -> tuple[Any, Any]:
        if self._point_solver is not None and oil_temperature is None and is_plain(point):
            # What a control loop asks for at every message, without the cost of arrays.
            return self._point_solver.solve(*point)
        points, scalar = OperatingPoints.checked(*point, oil_temperature)
        efficiency, output_speed = self.answer_at(points)
        return _like(efficiency, scalar), _like(output_speed, scalar)

    def predict(
        self, displacement_ratio: ArrayLike, engine_speed: ArrayLike, load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
    ) -> Prediction:
        """Efficiency with its standard error, and whether the point was covered by the data."""
        point = displacement_ratio, engine_speed, load_torque
        if self._point_solver is not None and oil_temperature is None and is_plain(point):
            return self._predict_point(self._point_solver, *point)
        points, scalar = OperatingPoints.checked(
            displacement_ratio, engine_speed, load_torque, oil_temperature)
        inside = (self.domain.contains(points) if self.domain is not None
                  else np.zeros(points.engine_speed.shape, dtype=bool))
        found = self.answer_at(points).efficiency, self._standard_error(points), inside
        return Prediction(*(_like(values, scalar) for values in found))

    def power_loss(
        self, displacement_ratio: ArrayLike, engine_speed: ArrayLike, load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
    ) -> Any:
        """Engine power that does not arrive at the output [W], by the efficiency a bench reads."""
        efficiency = self.efficiency(
            displacement_ratio, engine_speed, load_torque, oil_temperature)
        lost = np.multiply(engine_speed, load_torque) * (1.0 / efficiency - 1.0)
        return lost if np.ndim(lost) else float(lost)

    def refusal(
        self, displacement_ratio: float, engine_speed: float, load_torque: float,
        oil_temperature: float | None = None,
    ) -> str | None:
        """Say why the model has no answer at a point, or None where it has one."""
        found = self.efficiency(displacement_ratio, engine_speed, load_torque, oil_temperature)
        reason = STALLED if self.formulation == "power_balance" else INCONSISTENT
        return None if np.isfinite(found).all() else reason

    def breakdown(
        self, displacement_ratio: ArrayLike, engine_speed: ArrayLike, load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
    ) -> Breakdown:
        """Watts lost in each part.

        Raises:
            InputError: the formulation is not `power_balance`.
        """
        if self.formulation != "power_balance":
            raise InputError("a breakdown of watts needs formulation power_balance")
        points, scalar = OperatingPoints.checked(
            displacement_ratio, engine_speed, load_torque, oil_temperature)
        effects = self.without_meters().effects
        found = BalanceSolver(self.stage, self.parameters, effects).breakdown(points)
        return Breakdown(_like(found.input_power, scalar), _like(found.output_power, scalar), {
            name: _like(watts, scalar) for name, watts in found.losses.items()})

    def optimal_displacement_ratio(
        self,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        *,
        hold: str = "engine_speed",
        displacement_ratio: ArrayLike | None = None,
        output_speed: ArrayLike | None = None,
        engine_speed_limits: tuple[float, float] = ENGINE_SPEED_LIMITS,
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
        if isinstance(model._solver, PublishedSolver):
            raise InputError(NO_OPTIMUM)
        return optimum(model._solver, model._point_solver, engine_speed, load_torque, hold,
                       displacement_ratio, output_speed, engine_speed_limits)

    def efficiency_map(
        self, displacement_ratios: ArrayLike, engine_speeds: ArrayLike, load_torques: ArrayLike
    ) -> EfficiencyMap:
        """Efficiency on a grid.

        Raises:
            InputError: an axis is empty, not of shape (n,) or out of range.
        """
        axes = strokes, speeds, torques = [
            np.atleast_1d(np.asarray(axis, dtype=float))
            for axis in (displacement_ratios, engine_speeds, load_torques)]
        for name, axis in zip(AXES, axes, strict=True):
            if axis.ndim != 1 or axis.size == 0:
                raise InputError(f"map axis {name} has shape {axis.shape}; needs (n,) with n > 0")
        values = self.without_meters().efficiency(*np.meshgrid(*axes, indexing="ij", sparse=True))
        return EfficiencyMap(strokes, speeds, torques, values, self.domain)

    # --- the same for points already checked ----------------------------------------------------

    def answer_at(self, points: OperatingPoints) -> Answer:
        """Efficiency and output speed at checked points of one shape."""
        return Answer(*_in_chunks(self._solver.solve, points))

    def readings_at(self, points: OperatingPoints) -> Array:
        """Efficiency, output speed and pressure over the motor [Pa] at checked points, (3, ...).

        Raises:
            InputError: the formulation is not `power_balance`.
        """
        if self.formulation != "power_balance":
            raise InputError("a pressure needs formulation power_balance")
        solver = BalanceSolver(self.stage, self.parameters, self.effects)
        return _in_chunks(solver.readings, points)

    def efficiency_of_candidates(self, values: Array, points: OperatingPoints) -> Array:
        """Efficiency with other parameters than the model's own, for many candidates at once [-].

        Args:
            values: (leakage, f_m, f_p) of each candidate, shape (..., 3), SI units, unchecked.
            points: checked points of shape (n,).

        Returns:
            Shape (..., n); NaN where the formulation has no answer.
        """
        rows, n = values.reshape(-1, values.shape[-1]), len(points.engine_speed)
        found, part = np.empty((len(rows), n)), max(1, _CHUNK // max(1, n))
        for i in range(0, len(rows), part):
            solver = self._solver_of(Candidates(*rows[i:i + part].T[:, :, None]))
            found[i:i + part] = solver.solve(points).efficiency
        return found.reshape(*values.shape[:-1], n)

    @cached_property
    def _errors_and_steps(self) -> tuple[Array, Array]:
        """Standard errors of the parameters, and steps that show what each does to an answer."""
        errors = np.array([self.standard_errors[name] for name in PARAMETER_NAMES])
        base = self.parameters.to_array()
        # A step of a thousandth of the error stays in the linear range, also next to a bound.
        steps = np.maximum(1e-3 * errors, 1e-6 * base + 1e-18)
        highest = [limits.high for limits in PARAMETER_RANGES]
        return errors, np.where(base + steps <= highest, steps, -steps)

    @cached_property
    def _point_neighbours(self) -> list[PointSolver]:
        values = self.parameters.to_array() + np.diag(self._errors_and_steps[1])
        return [PointSolver(self.stage, HydraulicParameters(*row)) for row in values.tolist()]

    def _predict_point(self, solver: PointSolver, *point: float) -> Prediction:
        """`predict` at one point in range, without the cost of arrays."""
        here, error = solver.solve(*point)[0], math.nan
        if self.standard_errors and self.correlation is not None:
            errors, steps = self._errors_and_steps
            there = [neighbour.solve(*point)[0] for neighbour in self._point_neighbours]
            gradient = (np.array(there) - here) / steps * errors
            error = math.sqrt(max(float(gradient @ self.correlation @ gradient), 0.0))
        inside = self.domain is not None and not self.domain.departures(*point)
        return Prediction(here, error, inside)

    def _standard_error(self, points: OperatingPoints) -> Array:
        if not self.standard_errors or self.correlation is None:
            return np.full(points.engine_speed.shape, np.nan)
        errors, steps = self._errors_and_steps
        base = self.parameters.to_array()
        flat = points.map(np.ravel)
        here, *there = self.efficiency_of_candidates(
            np.vstack([base, base + np.diag(steps)]), flat)
        slope = ((np.array(there) - here).T / steps).reshape(*points.engine_speed.shape, -1)
        gradient = slope * errors
        variance = np.einsum("...i,ij,...j->...", gradient, self.correlation, gradient)
        # `published` takes a fixed eta_H at eps = 0: its parameters say nothing there.
        blind = (slope == 0.0).all(axis=-1)
        return np.where(blind, np.nan, np.sqrt(np.maximum(variance, 0.0)))

    # --- the model as data ----------------------------------------------------------------------

    def to_mapping(self) -> dict[str, Any]:
        """Return plain data, as a parameter file holds it: strings, numbers, lists, mappings."""
        parameters = {}
        for name in PARAMETER_NAMES:
            entry: dict[str, Any] = {"value": getattr(self.parameters, name),
                                     "unit": PARAMETER_UNITS[name]}
            if name in self.standard_errors:
                entry["standard_error"] = float(self.standard_errors[name])
            parameters[name] = entry
        data: dict[str, Any] = {"schema": SCHEMA, "formulation": self.formulation,
                                "parameters": parameters}
        if self.correlation is not None:
            data["correlation"] = np.asarray(self.correlation).round(6).tolist()
        if self.effects:
            data["effects"] = [effect_to_mapping(effect) for effect in self.effects]
        if self.domain is not None:
            data["domain"] = self.domain.to_mapping()
        data["provenance"] = dict(self.provenance)
        data["transmission"] = self.stage.to_mapping()
        return data

    @cached_property
    def fingerprint(self) -> str:
        """Twelve hexadecimal digits that change when the physics changes, not the provenance."""
        physics = {name: value for name, value in self.to_mapping().items()
                   if name in ("formulation", "transmission", "effects")}
        physics["parameters"] = self.parameters.to_array().tolist()
        text = json.dumps(physics, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]


def _in_chunks(solve: Callable[[OperatingPoints], Any], points: OperatingPoints) -> Array:
    """Rows that `solve` gives at points, shape (rows, ...)."""
    shape, flat = points.engine_speed.shape, points.map(np.ravel)
    parts = [np.stack(solve(flat.map(lambda axis, i=i: axis[i:i + _CHUNK])))
             for i in range(0, max(points.engine_speed.size, 1), _CHUNK)]
    return np.concatenate(parts, axis=1).reshape(len(parts[0]), *shape)


def _like(values: NDArray[Any], scalar: bool) -> Any:
    return values[0].item() if scalar else values
