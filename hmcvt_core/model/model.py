# SPDX-License-Identifier: Apache-2.0
"""The efficiency model: what users hold in their hands."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..physics import power_balance, published
from ..physics.breakdown import Breakdown, breakdown
from ..physics.closed_form import ClosedForm
from ..physics.closed_form_arrays import CHUNK, ArrayForm
from ..physics.effects.base import Effect
from ..physics.power_balance import OperatingPoints
from ..transmission.parameters import (
    LEAKAGE,
    MOTOR_DAMPING,
    PARAMETER_NAMES,
    PUMP_DAMPING,
    Candidates,
    HydraulicParameters,
)
from ..transmission.ranges import (
    DISPLACEMENT_RATIO,
    ENGINE_SPEED,
    ENGINE_SPEED_LIMITS,
    LOAD_TORQUE,
    OIL_TEMPERATURE,
    in_range,
)
from ..transmission.stage import Stage
from .domain import Domain
from .efficiency_map import EfficiencyMap, efficiency_map
from .optimum import Optimum, optimum

Array = NDArray[np.float64]
FORMULATIONS = ("power_balance", "published")

STALLED = "the load cannot be carried: the leakage takes the whole flow of the pump"
INCONSISTENT = ("the published formulas contradict themselves here (pole of eq. (11), "
                "or an efficiency outside 0 to 1)")


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
    def closed_form(self) -> ClosedForm | None:
        """The balance solved on paper; None where effects or the formulation rule that out."""
        return ClosedForm(self.stage, self.parameters) if self._is_solved else None

    @cached_property
    def _array_form(self) -> ArrayForm | None:
        return ArrayForm(self.stage, self.parameters) if self._is_solved else None

    @property
    def _is_solved(self) -> bool:
        return not self.effects and self.formulation == "power_balance"

    def without_meters(self) -> EfficiencyModel:
        """Return the model of the transmission alone, without errors of the bench's meters."""
        return self._of_transmission

    @cached_property
    def _of_transmission(self) -> EfficiencyModel:
        physical = tuple(effect for effect in self.effects if effect.component != "sensor")
        return self if len(physical) == len(self.effects) else replace(self, effects=physical)

    # --- values -------------------------------------------------------------------------------

    def efficiency(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
    ) -> Any:
        """Efficiency that a bench reads [-]; see the class for units, shapes and errors."""
        point = (displacement_ratio, engine_speed, load_torque)
        if self.closed_form is not None and _is_plain(point) and oil_temperature is None:
            # What a control loop asks for at every message, without the cost of arrays.
            return self.closed_form.efficiency(*point)
        points, scalar = _points(displacement_ratio, engine_speed, load_torque, oil_temperature)
        return _like(self.efficiency_at(points), scalar)

    def output_speed(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
    ) -> Any:
        """Speed of the output shaft with slip [rad/s] (`published`: without slip, eq. (5))."""
        point = (displacement_ratio, engine_speed, load_torque)
        if self.closed_form is not None and _is_plain(point) and oil_temperature is None:
            return self.closed_form.output_speed(*point)
        points, scalar = _points(displacement_ratio, engine_speed, load_torque, oil_temperature)
        return _like(self.output_speed_at(points), scalar)

    def predict(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
    ) -> Prediction:
        """Efficiency with its standard error, and whether the point was covered by the data."""
        points, scalar = _points(displacement_ratio, engine_speed, load_torque, oil_temperature)
        inside = (self.domain.contains(points) if self.domain is not None
                  else np.zeros(points.engine_speed.shape, dtype=bool))
        return Prediction(_like(self.efficiency_at(points), scalar),
                          _like(self._standard_error(points), scalar), _like(inside, scalar))

    def refusal(
        self,
        displacement_ratio: float,
        engine_speed: float,
        load_torque: float,
        oil_temperature: float | None = None,
    ) -> str | None:
        """Say why the model has no answer at a point, or None where it has one."""
        points, _ = _points(displacement_ratio, engine_speed, load_torque, oil_temperature)
        if np.isfinite(self.efficiency_at(points)).all():
            return None
        return STALLED if self.formulation == "power_balance" else INCONSISTENT

    def breakdown(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
    ) -> Breakdown:
        """Watts lost in each part.

        Raises:
            InputError: the formulation is not `power_balance`.
        """
        if self.formulation != "power_balance":
            raise InputError("a breakdown of watts needs formulation power_balance")
        points, scalar = _points(displacement_ratio, engine_speed, load_torque, oil_temperature)
        effects = self.without_meters().effects
        flow = power_balance.power_flow(self.stage, self.parameters, points, effects)
        found = breakdown(self.stage, self.parameters, flow, effects)
        return Breakdown(_like(found.input_power, scalar), _like(found.output_power, scalar),
                         {name: _like(watts, scalar) for name, watts in found.losses.items()})

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
        """Displacement ratio (and engine speed) that wastes least; see `optimum.optimum`."""
        return optimum(self.without_meters(), engine_speed, load_torque, hold=hold,
                       displacement_ratio=displacement_ratio, output_speed=output_speed,
                       engine_speed_limits=engine_speed_limits)

    def efficiency_map(
        self, displacement_ratios: ArrayLike, engine_speeds: ArrayLike, load_torques: ArrayLike
    ) -> EfficiencyMap:
        """Efficiency on a grid; each axis has shape (n,)."""
        return efficiency_map(self.without_meters(), displacement_ratios, engine_speeds,
                              load_torques)

    # --- the same for points already checked ----------------------------------------------------

    def efficiency_at(self, points: OperatingPoints) -> Array:
        """Efficiency at checked points of one shape [-]."""
        if self.formulation == "published":
            return published.published_efficiency(self.stage, self.parameters, points)
        if self._array_form is not None:
            return self._array_form.efficiency_in_parts(*points[:3])
        flow = power_balance.power_flow(self.stage, self.parameters, points, self.effects)
        return power_balance.efficiency(flow, self.effects)

    def efficiency_of_candidates(self, values: Array, points: OperatingPoints) -> Array:
        """Efficiency with other parameters than the model's own, for many candidates at once [-].

        Args:
            values: (leakage, f_m, f_p) of each candidate, shape (..., 3), SI units, unchecked.
            points: checked points of shape (n,).

        Returns:
            Shape (..., n); NaN where the formulation has no answer.
        """
        rows = values.reshape(-1, values.shape[-1])
        n = len(points.engine_speed)
        found = np.empty((len(rows), n))
        part = max(1, CHUNK // max(1, n))
        for i in range(0, len(rows), part):
            found[i:i + part] = self._efficiency_of(Candidates.of(rows[i:i + part]), points)
        return found.reshape(*values.shape[:-1], n)

    def _efficiency_of(self, many: Candidates, points: OperatingPoints) -> Array:
        if self._is_solved:
            return ArrayForm(self.stage, many).efficiency(*points[:3])
        shape = (len(many.leakage), len(points.engine_speed))
        spread = OperatingPoints._make(None if axis is None else np.broadcast_to(axis, shape)
                                       for axis in points)
        if self.formulation == "published":
            return published.published_efficiency(self.stage, many, spread)
        flow = power_balance.power_flow(self.stage, many, spread, self.effects)
        return power_balance.efficiency(flow, self.effects)

    def output_speed_at(self, points: OperatingPoints) -> Array:
        """Output speed at checked points of one shape [rad/s]."""
        if self.formulation == "published":
            return points.engine_speed * published.speed_ratio(
                self.stage, points.displacement_ratio)
        flow = power_balance.power_flow(self.stage, self.parameters, points, self.effects)
        speed = flow.state.output_speed
        for effect in self.effects:
            speed = effect.output_speed_reading(speed)
        return speed

    def _standard_error(self, points: OperatingPoints) -> Array:
        if not self.standard_errors or self.correlation is None:
            return np.full(points.engine_speed.shape, np.nan)
        errors = np.array([self.standard_errors[name] for name in PARAMETER_NAMES])
        base = self.parameters.to_array()
        # A step of a thousandth of the error stays in the linear range, also next to a bound.
        steps = np.maximum(1e-3 * errors, 1e-6 * base + 1e-18)
        here = self.efficiency_at(points)
        slopes = []
        for i, limits in enumerate((LEAKAGE, MOTOR_DAMPING, PUMP_DAMPING)):
            step = steps[i] if base[i] + steps[i] <= limits.high else -steps[i]
            moved = base.copy()
            moved[i] += step
            there = replace(self, parameters=HydraulicParameters(*moved)).efficiency_at(points)
            slopes.append((there - here) / step)
        slope = np.stack(slopes, axis=-1)
        gradient = slope * errors
        variance = np.einsum("...i,ij,...j->...", gradient, self.correlation, gradient)
        # `published` takes a fixed eta_H at eps = 0: its parameters say nothing there.
        blind = (slope == 0.0).all(axis=-1)
        return np.where(blind, np.nan, np.sqrt(np.maximum(variance, 0.0)))

    # --- the model as data ----------------------------------------------------------------------

    def to_mapping(self) -> dict[str, Any]:
        """Return plain data, as a parameter file holds it."""
        from .parameter_file import to_mapping

        return to_mapping(self)

    @cached_property
    def fingerprint(self) -> str:
        """Twelve hexadecimal digits that change when the physics changes, not the provenance."""
        physics = {name: value for name, value in self.to_mapping().items()
                   if name in ("formulation", "transmission", "effects")}
        physics["parameters"] = self.parameters.to_array().tolist()
        text = json.dumps(physics, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the parameter file, whole or not at all."""
        from .parameter_file import save_model

        save_model(self, path)


def _is_plain(point: tuple[Any, Any, Any]) -> TypeGuard[tuple[float, float, float]]:
    """Tell whether a point is of plain floats in range; the rest is left to `_points`."""
    return all(type(value) is float for value in point) and in_range(*point)


def _points(
    displacement_ratio: ArrayLike,
    engine_speed: ArrayLike,
    load_torque: ArrayLike,
    oil_temperature: ArrayLike | None,
) -> tuple[OperatingPoints, bool]:
    checked = [
        DISPLACEMENT_RATIO.check(displacement_ratio),
        ENGINE_SPEED.check(engine_speed),
        LOAD_TORQUE.check(load_torque),
    ]
    if oil_temperature is not None:
        checked.append(OIL_TEMPERATURE.check(oil_temperature))
    scalar = all(value.ndim == 0 for value in checked)
    try:
        arrays = np.broadcast_arrays(*checked)
    except ValueError:
        shapes = ", ".join(str(value.shape) for value in checked)
        raise InputError(f"operating points of shapes {shapes} do not broadcast") from None
    return OperatingPoints(*(np.atleast_1d(array) for array in arrays)), scalar


def _like(values: NDArray[Any], scalar: bool) -> Any:
    return values[0].item() if scalar else values
