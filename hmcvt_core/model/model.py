# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The efficiency model: lookup, uncertainty, losses, optimum and map of a transmission."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import repeat
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..files import picture, preformatted
from ..files.bench import BenchSamples
from ..physics.balance import BalanceSolver
from ..physics.effects import effect_to_mapping
from ..physics.effects.base import Effect
from ..physics.effects.empirical import EmpiricalLoss
from ..physics.effects.hydraulic import REFERENCE_TEMPERATURE
from ..physics.formulation import FORMULATIONS as _FORMULATIONS
from ..physics.formulation import Formulation, Solver, formulation_named
from ..physics.single_point import PointSolver
from ..transmission import ranges
from ..transmission.parameters import (
    PARAMETER_RANGES,
    TYPICAL_PARAMETERS,
    Candidates,
    HydraulicParameters,
    Parameters,
)
from ..transmission.quantities import PREDICTED, holds_numbers
from ..transmission.ranges import Array, OperatingPoints, Solution
from ..transmission.stage import Stage, stages_to_mapping
from .breakdown import Breakdown
from .domain import AXES, Domain, EfficiencyMap, Prediction
from .engine import Engine
from .intervals import LEVEL, MIN_DEGREES, half_width
from .measured_unit import MeasuredUnit
from .optimum import DriveOptimum, Optimum, drive_optimum, optimum
from .part_checks import require_effects, require_parameters, require_stages

SCHEMA = "hmcvt-model/1"
FORMULATIONS = tuple(_FORMULATIONS)
"""Names of the formulations."""

NO_OPTIMUM = (
    "formulation 'published' has no optimum: it has a pole, eq. (11), and "
    "peaks where eq. (8) alone sees no hydraulic power; take power_balance"
)

_SLOW, _FAST = ranges.ENGINE_SPEED.low, ranges.ENGINE_SPEED.high
_OVERRUN, _PULL = ranges.ANY_LOAD.low, ranges.ANY_LOAD.high
_COLD, _HOT = ranges.OIL_TEMPERATURE.low, ranges.OIL_TEMPERATURE.high
_PHYSICS = ("formulation", "transmission", "effects")
"""Keys of a parameter file that the fingerprint covers, in addition to the parameters."""
_NUMBERS = frozenset(
    (
        *(float, int, np.float64, np.float32, np.float16),
        *(np.int64, np.int32, np.int16, np.int8),
        *(np.uint64, np.uint32, np.uint16, np.uint8),
    )
)
"""Types of scalars that a lookup takes without arrays."""
_FLOAT = {float}
"""Types in a list that is taken as it is."""
_COLUMNS = _NUMBERS | {np.ndarray, list, tuple}
"""Types that are taken point by point."""
_FEW = 100
"""Points from which on arrays are faster (`python -m studies.timing`)."""
_FILLED = (0.0, 100.0, 100.0)
"""Operating point (SI) that stands for a masked one while it is solved."""
_ERROR_STEP = 1e-3
"""Step of a parameter, in its standard errors: within the linear range, also next to a bound."""


@dataclass(frozen=True, eq=False)
class EfficiencyModel:
    """Efficiency of one stage at any operating point, or of all stages of a transmission.

    Angular speeds are in rad/s, torques in N m; `load_torque` is referred to the engine shaft
    (output power / engine speed). The methods take floats, or arrays and lists that broadcast, and
    return floats for floats. Input outside the ranges of `hmcvt_core.transmission.ranges` raises
    `InputError`. NaN means that the formulation has no answer at a permitted point; `refusal` says
    why.

    Several stages of one transmission share pump and motor, and so the parameters. With several,
    `stage` names the one engaged, for each point or for all; `stages` holds each as a model.

    A model whose effects hold an error of a meter (component `sensor`) predicts what that bench
    reads: `efficiency`, `output_speed` and `predict`. Its optimum, map and breakdown are those of
    the transmission, `without_meters()`, and so is what the node serves.

    Attributes:
        stage: gear train and pump-motor pair.
        parameters: the hydraulic parameters.
        formulation: `power_balance` (served) or `published` (the paper's formulas, guarded).
        effects: further losses and errors (power balance only).
        standard_errors: of the parameters by name; empty when unknown.
        correlation: of the parameters, shape (3, 3), or None.
        domain: box of the identification data, or None.
        provenance: where the parameters come from.
        other_stages: of the same transmission.
        units: pump and motor that were tested by themselves, by kind.
        misfit: root mean square of what the model misses at samples left out of its fit, beyond
            noise and errors of the parameters [-]; 0 where it is not known.
        remainder_deviation: standard deviation of an empirical remainder far from the bumps that
            state it [-]; 0 where there is none.
        degrees_of_freedom: of the scatter behind the standard errors; None where it is known or
            stated, so that errors are normal. `interval` and `parameter_intervals` use it.
        intervals: of the parameters at 90 % by name, (low, high), by profile likelihood; empty
            where standard errors stand for them.

    Raises:
        InputError: an argument is of another type, or the formulation does not hold for the stage.
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
    units: Mapping[str, MeasuredUnit] = field(default_factory=dict)
    misfit: float = 0.0
    remainder_deviation: float = 0.0
    degrees_of_freedom: float | None = None
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_stages([self.stage, *self.other_stages])
        require_parameters(self.parameters)
        require_effects(self.effects)
        ranges.MISFIT.check(self.misfit)
        ranges.MISFIT.check(self.remainder_deviation, "remainder_deviation")
        free = self.degrees_of_freedom
        if free is not None and not free >= MIN_DEGREES:
            raise InputError(
                f"degrees_of_freedom = {free!r}: needs a number of at least "
                f"{MIN_DEGREES:g}, or None"
            )
        self._formulation.require_valid(self.stage, self.effects)

    def __getstate__(self) -> dict[str, Any]:
        # Without the caches.
        return {item.name: getattr(self, item.name) for item in fields(self)}

    @property
    def _formulation(self) -> Formulation:
        return formulation_named(self.formulation)

    @property
    def states_errors(self) -> bool:
        """Whether standard errors and correlation of the parameters are known."""
        return bool(self.standard_errors) and self.correlation is not None

    @cached_property
    def stages(self) -> Mapping[str, EfficiencyModel]:
        """A model of each stage by its name, in the order of the file."""
        return {
            stage.name: replace(self, stage=stage, other_stages=())
            for stage in (self.stage, *self.other_stages)
        }

    def in_stage(self, name: str | None) -> EfficiencyModel:
        """Return the model of one stage, or itself for None.

        Raises:
            InputError: the transmission has no such stage.
        """
        if name is None:
            return self
        if name not in self.stages:
            raise InputError(
                f"stage {name!r} is not known to the model; there is "
                f"{', '.join(self.stages)}"
            )
        return self.stages[name]

    @cached_property
    def _point_solvers(self) -> Mapping[str | None, PointSolver]:
        """What solves single points, by name of the stage; None of a single stage."""
        solvers: dict[str | None, PointSolver] = {}
        for name, model in self.stages.items():
            solver = model._solver
            at_point = solver.at_point if isinstance(solver, BalanceSolver) else None
            if at_point is None:
                continue
            solvers[name] = at_point
            if not self.other_stages:
                solvers[None] = at_point
        return solvers

    @cached_property
    def _solver(self) -> Solver:
        return self._solver_of(self.parameters)

    def _solver_of(self, parameters: Parameters) -> Solver:
        return self._formulation.solver(self.stage, parameters, self.effects)

    def balance(self, refusal: str) -> BalanceSolver:
        """Return the solver of the power balance.

        Args:
            refusal: text of the error.

        Raises:
            InputError: the formulation is another one.
        """
        solver = self._solver
        if not isinstance(solver, BalanceSolver):
            raise InputError(refusal)
        return solver

    def with_errors(
        self,
        standard_errors: Mapping[str, float],
        correlation: Array | None,
        degrees_of_freedom: float | None = None,
    ) -> EfficiencyModel:
        """Return the model with other errors of its parameters, without intervals of another fit.

        Args:
            standard_errors: by name, in the units of the parameters; empty where not known.
            correlation: of the parameters, shape (3, 3); None where not known.
            degrees_of_freedom: of the scatter in the errors; None for normal errors.
        """
        return replace(
            self,
            standard_errors=standard_errors,
            correlation=correlation,
            degrees_of_freedom=degrees_of_freedom,
            intervals={},
        )

    def without_meters(self) -> EfficiencyModel:
        """Return the model of the transmission alone, without errors of the bench's meters."""
        physical = tuple(
            effect for effect in self.effects if effect.component != "sensor"
        )
        if len(physical) == len(self.effects):
            return self
        return replace(self, effects=physical)

    # --- values -------------------------------------------------------------------------------

    @overload
    def efficiency(
        self,
        displacement_ratio: float,
        engine_speed: float,
        load_torque: float,
        oil_temperature: float | None = None,
        stage: str | None = None,
    ) -> float: ...

    @overload
    def efficiency(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
        stage: ArrayLike | None = None,
    ) -> Array: ...

    def efficiency(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
        stage: ArrayLike | None = None,
    ) -> Any:
        """Efficiency that a bench reads [-].

        Args:
            displacement_ratio: pump stroke [-].
            engine_speed: [rad/s].
            load_torque: output power / engine speed [N m].
            oil_temperature: [deg C]; only effects read it.
            stage: name of the stage engaged; needed where the model has several.

        Returns:
            A float for floats, else an array; NaN where the formulation has no answer.

        Raises:
            InputError: input is out of range, or several stages and none is named.
        """
        return self._answer(
            displacement_ratio, engine_speed, load_torque, oil_temperature, stage
        )[0]

    @overload
    def output_speed(
        self,
        displacement_ratio: float,
        engine_speed: float,
        load_torque: float,
        oil_temperature: float | None = None,
        stage: str | None = None,
    ) -> float: ...

    @overload
    def output_speed(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
        stage: ArrayLike | None = None,
    ) -> Array: ...

    def output_speed(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
        stage: ArrayLike | None = None,
    ) -> Any:
        """Speed of the output shaft with slip [rad/s] (`published`: without slip, eq. (5)).

        Arguments, shapes and errors are those of `efficiency`.
        """
        return self._answer(
            displacement_ratio, engine_speed, load_torque, oil_temperature, stage
        )[1]

    @overload
    def power_loss(
        self,
        displacement_ratio: float,
        engine_speed: float,
        load_torque: float,
        oil_temperature: float | None = None,
        stage: str | None = None,
    ) -> float: ...

    @overload
    def power_loss(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
        stage: ArrayLike | None = None,
    ) -> Array: ...

    def power_loss(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
        stage: ArrayLike | None = None,
    ) -> Any:
        """Engine power less output power [W], at any load: zero and overrun (negative) included.

        Arguments, shapes and errors are those of `efficiency`.
        """
        torque = self.without_meters()._answer(
            displacement_ratio, engine_speed, load_torque, oil_temperature, stage
        )[2]
        if type(torque) is float:
            return float(engine_speed) * (torque - float(load_torque))  # type: ignore[arg-type]
        load = np.asanyarray(load_torque, dtype=float)
        speed = np.asanyarray(engine_speed, dtype=float)
        return _plain(speed * (torque - load))

    def _answer(
        self,
        displacement_ratio: Any,
        engine_speed: Any,
        load_torque: Any,
        oil_temperature: Any,
        stage: Any,
    ) -> Sequence[Any]:
        """Efficiency, output speed and engine torque."""
        # No effect, no use for the temperature.
        if type(oil_temperature) in _NUMBERS and not self.effects:
            is_known = _COLD <= oil_temperature <= _HOT
            oil_temperature = None if is_known else oil_temperature
        # A control loop asks for single points at every message, without the cost of arrays.
        if oil_temperature is None and (stage is None or isinstance(stage, str)):
            at_point = self._point_solvers.get(stage)
            if at_point is not None:
                stroke, speed, load = displacement_ratio, engine_speed, load_torque
                if not type(stroke) is type(speed) is type(load) is float:
                    stroke, speed, load = _as_floats(stroke, speed, load)
                # Written out: a call of `_in_range` takes as long as three products.
                if (
                    -1.0 <= stroke <= 1.0
                    and _SLOW <= speed <= _FAST
                    and _OVERRUN <= load <= _PULL
                ):
                    return at_point(stroke, speed, load)
        self._require_stage(stage)
        point = (displacement_ratio, engine_speed, load_torque)
        if isinstance(stage, str):
            return self.in_stage(stage)._answer(*point, oil_temperature, None)
        if oil_temperature is None:
            few = self._answer_few(point, stage)
            if few is not None:
                return few
        mask = _mask_of(point, oil_temperature)
        if mask is not None:
            point, oil_temperature = _filled(point, oil_temperature)
        points = OperatingPoints.checked(point, oil_temperature, stage)
        rows = self.solution_at(points)
        if mask is not None:
            return [
                np.ma.masked_array(values, mask=_spread(mask, values))
                for values in rows
            ]
        return [_plain(values) for values in rows]

    def _answer_few(self, point: Sequence[Any], stage: Any) -> list[Any] | None:
        """Return what `_answer` returns, point by point; None where that is slower or wrong.

        Of up to `_FEW` points the overhead of arrays is the larger part.
        """
        few = _few_points(point)
        if few is None:
            return None
        columns, shape = few
        solvers: Iterable[PointSolver | None]
        if stage is None:
            solvers = repeat(self._point_solvers.get(None))
        else:
            names = np.asarray(stage, dtype=str)
            if names.shape != shape:
                return None
            solvers = map(self._point_solvers.get, names.ravel().tolist())
        rows = []
        for at_point, stroke, speed, load in zip(solvers, *columns, strict=False):
            if at_point is None or not _in_range(stroke, speed, load):
                return None
            rows.append(at_point(stroke, speed, load))
        if not rows:
            return None
        return [column.reshape(shape) for column in np.array(rows).T]

    def _require_stage(self, stage: ArrayLike | None) -> None:
        if stage is None and self.other_stages:
            raise InputError(
                f"the model has the stages {', '.join(self.stages)}: name the one engaged "
                "as stage=, or take its model from .stages"
            )

    def predict(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
        stage: ArrayLike | None = None,
    ) -> Prediction:
        """Efficiency with its standard error, and whether the data covered the point.

        The standard error holds the errors of the parameters and `misfit`, and grows away from the
        bumps of an empirical remainder. Arguments, shapes and errors are those of `efficiency`.
        """
        point = (displacement_ratio, engine_speed, load_torque)
        efficiency: Any = self.efficiency(*point, oil_temperature, stage)
        if type(efficiency) is float:
            changes = []
            for steps, model in self.neighbours:
                changed: Any = model.efficiency(*point, oil_temperature, stage)
                changes.append((changed - efficiency) * steps)
            rows = self._correlation_rows
            oil = self._oil_answered(oil_temperature)
            return self._predicted_point(efficiency, changes, rows, point, oil, stage)
        efficiency, slopes = self.sensitivity(*point, oil_temperature, stage)
        correlation = np.zeros((0, 0)) if self.correlation is None else self.correlation
        # NumPy multiplies no masked matrices.
        slopes = np.ma.getdata(slopes)
        variance = ((slopes @ correlation) * slopes).sum(axis=-1)
        # `published` takes a fixed eta_H at eps = 0, where its parameters change nothing.
        depends = slopes.any(axis=-1)
        variance = np.maximum(variance, 0.0) + self.misfit**2
        variance = variance + self._remainder_variance(point, stage)
        error = np.where(depends, np.sqrt(variance), np.nan)
        inside = np.zeros(error.shape, dtype=bool)
        if self.domain is not None:
            oil = self._oil_answered(oil_temperature)
            inside = inside | self.domain.contains(*point, oil)
        if isinstance(efficiency, np.ma.MaskedArray):
            mask = np.ma.getmaskarray(efficiency)
            return Prediction(
                efficiency,
                np.ma.masked_array(error, mask=mask),
                np.ma.masked_array(inside, mask=mask),
            )
        return Prediction(_plain(efficiency), _plain(error), _plain(inside))

    def _remainder_variance(
        self, point: Sequence[ArrayLike], stage: ArrayLike | None
    ) -> Array | float:
        """Return the variance of an empirical remainder at points [-].

        That of a Gaussian process whose value is known at the nearest bump, s^2 (1 - k^2).
        """
        if self.remainder_deviation == 0.0:
            return 0.0
        names = self.stage.name if stage is None else stage
        axes = [np.asarray(values, dtype=float) for values in point]
        *axes, names = np.broadcast_arrays(*axes, np.asarray(names))
        nearest = np.zeros(axes[0].shape)
        for effect in self.effects:
            if isinstance(effect, EmpiricalLoss):
                acts = names == effect.stage if effect.stage else True
                nearest = np.maximum(nearest, acts * effect.closeness(*axes))
        return np.asarray(self.remainder_deviation**2 * (1.0 - nearest**2))

    def _predicted_point(
        self,
        efficiency: float,
        slopes: Sequence[float],
        correlation: Sequence[Sequence[float]],
        point: Sequence[Any],
        oil_temperature: Any,
        stage: Any,
    ) -> Prediction:
        """Return what `predict` returns, for one point."""
        variance = 0.0
        for i, slope in enumerate(slopes):
            for j, other in enumerate(slopes):
                variance += slope * correlation[i][j] * other
        error = math.nan
        # `published` takes a fixed eta_H at eps = 0, where its parameters change nothing.
        if any(slopes):
            # NaN stays NaN, as of arrays.
            variance = 0.0 if variance < 0.0 else variance
            remainder = float(self._remainder_variance(point, stage))
            error = math.sqrt(variance + self.misfit**2 + remainder)
        inside = False
        if self.domain is not None:
            stroke, speed, load = map(float, point)
            oil = None if oil_temperature is None else float(oil_temperature)
            inside = self.domain.contains_point(stroke, speed, load, oil)
        return Prediction(efficiency, error, inside)

    def _oil_answered(self, oil_temperature: Any) -> Any:
        """Return the oil temperature that an answer is for [deg C]; None if no effect reads it."""
        if not self._depends_on_oil:
            return None
        return REFERENCE_TEMPERATURE if oil_temperature is None else oil_temperature

    @cached_property
    def _depends_on_oil(self) -> bool:
        return any(effect.depends_on_oil() for effect in self.effects)

    def departures(
        self,
        displacement_ratio: float,
        engine_speed: float,
        load_torque: float,
        oil_temperature: float | None = None,
    ) -> list[str]:
        """Return a sentence for each quantity of a point outside the identification data.

        Empty where the model does not state the range of its data.

        Args:
            displacement_ratio: [-].
            engine_speed: [rad/s].
            load_torque: [N m].
            oil_temperature: [deg C]; where an effect reads it, 60 deg C when left out.
        """
        if self.domain is None:
            return []
        oil = self._oil_answered(oil_temperature)
        return self.domain.departures(
            displacement_ratio, engine_speed, load_torque, oil
        )

    def interval(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
        stage: ArrayLike | None = None,
        *,
        level: float = LEVEL,
    ) -> tuple[Any, Any]:
        """Interval of the efficiency, (low, high), within 0 and 1; NaN where it is not known.

        Its width is Student's t of `degrees_of_freedom` times the standard error of `predict`.
        Arguments, shapes and errors are those of `efficiency`.

        Args:
            level: probability that the interval holds the efficiency.
        """
        prediction = self.predict(
            displacement_ratio, engine_speed, load_torque, oil_temperature, stage
        )
        return self.interval_of(prediction, level)

    def interval_of(
        self, prediction: Prediction, level: float = LEVEL
    ) -> tuple[Any, Any]:
        """Interval of a prediction that this model made; see `interval`."""
        width = half_width(self.degrees_of_freedom, level)
        efficiency, error = prediction[:2]
        if type(efficiency) is type(error) is float:
            # NaN stays NaN: it comes first.
            low = min(max(efficiency - error * width, 0.0), 1.0)
            high = min(max(efficiency + error * width, 0.0), 1.0)
            return low, high
        half = np.multiply(error, width)
        low = np.clip(prediction.efficiency - half, 0.0, 1.0)
        high = np.clip(prediction.efficiency + half, 0.0, 1.0)
        return _plain(low), _plain(high)

    def parameter_intervals(
        self, level: float = LEVEL
    ) -> dict[str, tuple[float, float]]:
        """Interval of each parameter, (low, high), in its unit; empty where errors are not known.

        None is below 0 or beyond the range of the parameter: at a bound the interval is one-sided.
        That of another level than 90 % has either side of `intervals` in proportion to Student's t.

        Args:
            level: probability that the interval holds the parameter.
        """
        if not self.standard_errors:
            return {}
        half = half_width(self.degrees_of_freedom, level)
        intervals = {}
        for limits in PARAMETER_RANGES:
            value = getattr(self.parameters, limits.name)
            error = half * self.standard_errors[limits.name]
            below = error
            above = error
            if limits.name in self._fitted_intervals:
                low, high = self._fitted_intervals[limits.name]
                scale = half / half_width(self.degrees_of_freedom)
                below = scale * (value - low)
                above = scale * (high - value)
            intervals[limits.name] = (
                max(value - below, limits.low),
                min(value + above, limits.high),
            )
        return intervals

    @cached_property
    def _fitted_intervals(self) -> Mapping[str, tuple[float, float]]:
        """`intervals`, unless a parameter was changed since and lies outside its own."""
        for name, (low, high) in self.intervals.items():
            if not low <= getattr(self.parameters, name) <= high:
                return {}
        return self.intervals

    def sensitivity(self, *point: Any) -> tuple[Any, Array]:
        """Efficiency, and its change by one standard error of each parameter, shape (..., 3).

        The point is given as for `efficiency`; the shape is (..., 0) where errors are not known.
        """
        efficiency = self.efficiency(*point)
        slopes = np.empty((*np.shape(efficiency), len(self.neighbours)))
        for i, (steps, model) in enumerate(self.neighbours):
            slopes[..., i] = (model.efficiency(*point) - efficiency) * steps
        if isinstance(efficiency, np.ma.MaskedArray):
            mask = np.ma.getmaskarray(efficiency)[..., None]
            return efficiency, np.ma.masked_array(slopes, mask=_spread(mask, slopes))
        return efficiency, slopes

    @cached_property
    def _correlation_rows(self) -> list[list[float]]:
        """Correlation of the parameters as plain floats."""
        return np.asarray(self.correlation, dtype=float).tolist()

    @cached_property
    def neighbours(self) -> list[tuple[float, EfficiencyModel]]:
        """Standard error of each parameter in steps, and the model one such step away."""
        if not self.states_errors:
            return []
        base = self.parameters.to_array()
        highest = [limits.high for limits in PARAMETER_RANGES]
        errors = np.array(Candidates(**self.standard_errors))
        steps = np.maximum(_ERROR_STEP * errors, 1e-6 * base + 1e-18)
        steps = np.where(base + steps <= highest, steps, -steps)
        neighbours = []
        for i, count in enumerate((errors / steps).tolist()):
            values = base.copy()
            values[i] += steps[i]
            parameters = HydraulicParameters(*values.tolist())
            neighbours.append((count, replace(self, parameters=parameters)))
        return neighbours

    def refusal(
        self,
        displacement_ratio: float,
        engine_speed: float,
        load_torque: float,
        oil_temperature: float | None = None,
        stage: str | None = None,
    ) -> str | None:
        """Return why the model has no answer at a point, or None where it has one."""
        efficiency, _, torque = self._answer(
            displacement_ratio, engine_speed, load_torque, oil_temperature, stage
        )
        if np.isfinite(efficiency).all():
            return None
        solver = self.in_stage(stage)._solver
        return solver.refusal(displacement_ratio, load_torque, torque)

    def breakdown(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
        stage: str | None = None,
    ) -> Breakdown:
        """Watts lost in each part; arguments as of `efficiency`, of one stage.

        Raises:
            InputError: as of `efficiency`, or the formulation is not `power_balance`.
        """
        self._require_stage(stage)
        model = self.without_meters().in_stage(stage)
        solver = model.balance("a breakdown of watts needs formulation power_balance")
        point = _as_floats(displacement_ratio, engine_speed, load_torque)
        at_point = solver.losses_at_point
        if at_point is not None and oil_temperature is None and _in_range(*point):
            of_point: Any = at_point.shares(*point)
            if of_point is not None:
                return Breakdown(
                    of_point.input_power,
                    of_point.output_power,
                    of_point.losses,
                    model.stage.name,
                )
        points = OperatingPoints.checked(
            (displacement_ratio, engine_speed, load_torque), oil_temperature
        )
        shape = points.engine_speed.shape
        flat = solver.breakdown(points.map(np.ravel))
        return Breakdown(
            _plain(flat.input_power.reshape(shape)),
            _plain(flat.output_power.reshape(shape)),
            {part: _plain(watts.reshape(shape)) for part, watts in flat.losses.items()},
            model.stage.name,
        )

    def optimal_displacement_ratio(
        self,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        *,
        hold: str = "engine_speed",
        displacement_ratio: ArrayLike | None = None,
        output_speed: ArrayLike | None = None,
        engine_speed_limits: tuple[float, float] = ranges.ENGINE_SPEED_LIMITS,
        stage: str | None = None,
        oil_temperature: float | None = None,
    ) -> Optimum:
        """Displacement ratio (and engine speed) that loses least.

        Args:
            engine_speed: now [rad/s].
            load_torque: now, output power / engine speed [N m]; broadcasts with the rest.
            hold: `engine_speed`, or `output_speed` to look for the best pair (engine speed,
                displacement ratio) that keeps output speed and output power.
            displacement_ratio: now [-]; gives the output speed to hold where that is left out.
            output_speed: to hold [rad/s].
            engine_speed_limits: lowest and highest engine speed allowed [rad/s].
            stage: name of the stage engaged; needed where the model has several.
            oil_temperature: at every point [deg C]; only effects read it.

        Returns:
            The best point, NaN where the model has no answer anywhere on the line.

        Raises:
            InputError: input is out of range, `hold` is unknown, the output speed to hold is not
                given, or the formulation is `published`, whose peak is an artefact of eq. (8).
        """
        self._require_stage(stage)
        model = self.without_meters().in_stage(stage)
        return optimum(
            model.balance(NO_OPTIMUM).at_oil_temperature(_checked_oil(oil_temperature)),
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
        inside_domain: bool = False,
        oil_temperature: float | None = None,
    ) -> DriveOptimum:
        """Stage, engine speed and displacement ratio of least fuel; see `drive_optimum`.

        With `inside_domain`, only within the data that the model was identified from.
        `oil_temperature` holds at every point [deg C]; only effects read it.
        """
        if inside_domain and self.domain is None:
            raise InputError(
                "inside_domain: the model does not state the range of its data"
            )
        oil = _checked_oil(oil_temperature)
        stages = {
            name: model.balance(NO_OPTIMUM).at_oil_temperature(oil)
            for name, model in self.without_meters().stages.items()
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
            self.domain if inside_domain else None,
        )

    def efficiency_map(
        self,
        displacement_ratios: ArrayLike,
        engine_speeds: ArrayLike,
        load_torques: ArrayLike,
        stage: str | None = None,
    ) -> EfficiencyMap:
        """Efficiency on a grid.

        Args:
            displacement_ratios: axis, shape (a,) [-].
            engine_speeds: axis, shape (b,) [rad/s].
            load_torques: axis, shape (c,) [N m].
            stage: name of the stage engaged; the first of the model when left out.

        Raises:
            InputError: an axis is empty, not of shape (n,) or out of range.
        """
        given = (displacement_ratios, engine_speeds, load_torques)
        axes = [
            np.atleast_1d(limits.check(axis))
            for limits, axis in zip(ranges.ANY_POINT, given, strict=True)
        ]
        for name, axis in zip(AXES, axes, strict=True):
            if axis.ndim != 1 or axis.size == 0:
                raise InputError(
                    f"map axis {name} has shape {axis.shape}; needs (n,) with n > 0"
                )
        grid = np.meshgrid(*axes, indexing="ij", sparse=True)
        model = self.without_meters().in_stage(stage or self.stage.name)
        inside = None
        if self.domain is not None:
            ratios, speeds, torques = grid
            oil = self._oil_answered(None)
            inside = self.domain.contains(ratios, speeds, torques, oil)
        return EfficiencyMap(
            axes[0],
            axes[1],
            axes[2],
            np.asarray(model.efficiency(*grid)),
            inside,
        )

    # --- the same for points already checked ----------------------------------------------------

    def solution_at(self, points: OperatingPoints) -> Solution:
        """Efficiency, output speed and engine torque at checked points of one shape."""
        rows = points.solved(lambda name, at: self.in_stage(name)._solver.solve(at))
        return Solution(*rows)

    def readings_at(self, points: OperatingPoints) -> dict[str, Array]:
        """Readings of a bench at checked points, by name of the quantity, in SI units.

        Raises:
            InputError: the formulation is not `power_balance`.
        """
        refusal = "a pressure needs formulation power_balance"

        def readings(name: str | None, at: OperatingPoints) -> list[Array]:
            balance = self.in_stage(name).balance(refusal)
            return list(balance.readings(at).values())

        rows = points.solved(readings)
        return dict(zip((channel.name for channel in PREDICTED), rows, strict=True))

    def efficiency_of_candidates(self, values: Array, points: OperatingPoints) -> Array:
        """Efficiency with the parameters of many candidates at once [-].

        Args:
            values: (leakage, f_m, f_p) of each candidate, shape (..., 3), SI units, unchecked.
            points: checked points of shape (n,).

        Returns:
            Shape (..., n); NaN where the formulation has no answer.
        """
        rows = values.reshape(-1, values.shape[-1])
        if (
            points.stage is None
            and len(rows) * points.engine_speed.size <= ranges.CHUNK
        ):
            # An annealing asks hundreds of times: without the detour over stages and chunks.
            solver = self._solver_of(Candidates(*rows.T[:, :, None]))
            return solver.solve(points).efficiency.reshape(*values.shape[:-1], -1)

        def solve(name: str | None, at: OperatingPoints) -> list[Array]:
            model = self.in_stage(name)
            size = max(1, ranges.CHUNK // max(1, at.engine_speed.size))
            parts = []
            for i in range(0, len(rows), size):
                candidates = Candidates(*rows[i : i + size].T[:, :, None])
                parts.append(model._solver_of(candidates).solve(at).efficiency)
            return [np.concatenate(parts)]

        return points.solved(solve)[0].reshape(*values.shape[:-1], -1)

    # --- the model as data ----------------------------------------------------------------------

    def to_mapping(self) -> dict[str, Any]:
        """Return plain data, as a parameter file holds it: strings, numbers, lists, mappings."""
        data: dict[str, Any] = {
            "schema": SCHEMA,
            "formulation": self.formulation,
            "parameters": self.parameters.to_mapping(self.standard_errors),
        }
        if self._fitted_intervals:
            data["interval_90"] = {
                name: list(map(float, ends))
                for name, ends in self._fitted_intervals.items()
            }
        if self.correlation is not None:
            data["correlation"] = np.asarray(self.correlation).round(6).tolist()
        if self.degrees_of_freedom is not None:
            data["degrees_of_freedom"] = float(self.degrees_of_freedom)
        if self.misfit > 0.0:
            data["misfit"] = float(self.misfit)
        if self.remainder_deviation > 0.0:
            data["remainder_deviation"] = float(self.remainder_deviation)
        if self.effects:
            data["effects"] = [effect_to_mapping(effect) for effect in self.effects]
        if self.domain is not None:
            data["domain"] = self.domain.to_mapping()
        data["provenance"] = dict(self.provenance)
        if self.units:
            data["provenance"]["units"] = {
                kind: unit.to_mapping() for kind, unit in self.units.items()
            }
        data["transmission"] = stages_to_mapping((self.stage, *self.other_stages))
        return data

    @cached_property
    def fingerprint(self) -> str:
        """Twelve hexadecimal digits that change when the physics changes, not the provenance."""
        data = self.to_mapping()
        physics = {name: data[name] for name in data if name in _PHYSICS}
        physics["parameters"] = self.parameters.to_array().tolist()
        text = json.dumps(physics, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def plot_map(
        self,
        power: float = 40e3,
        samples: BenchSamples | None = None,
        *,
        stage: str | None = None,
        ax: Any = None,
    ) -> Any:
        """Draw the efficiency at an output power over engine speed and speed ratio.

        Args:
            power: output power [W].
            samples: bench tests to mark.
            stage: name of the stage engaged; the first of the model when left out.
            ax: matplotlib axes to draw on; a new figure when left out.

        Returns:
            The matplotlib figure.
        """
        model = self.in_stage(stage or self.stage.name)
        return picture(model, power, samples=samples, ax=ax)

    def plot(self, ax: Any = None) -> Any:
        """Draw the efficiency at 40 kW, see `plot_map`."""
        return self.plot_map(ax=ax)

    def to_dict(self) -> dict[str, Any]:
        """Return the model as plain data for JSON; see `to_mapping`."""
        return self.to_mapping()

    def report(self) -> str:
        """Return formulation, stages and parameters as text."""
        lines = [f"{self.formulation}, stages: {', '.join(self.stages)}"]
        for name, entry in self.parameters.to_mapping(self.standard_errors).items():
            error = entry.get("standard_error")
            spread = "" if error is None else f" +- {error:.2g}"
            lines.append(f"  {name:<14} {entry['value']:.4g}{spread} {entry['unit']}")
        if self.misfit > 0.0:
            lines.append(f"  {'form error':<14} {self.misfit:.2g} -")
        for effect in self.effects:
            lines.append(f"  effect {effect.name}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return preformatted(self.report())


def typical_model(
    stages: Sequence[Stage], effects: Sequence[Effect] = ()
) -> EfficiencyModel:
    """Return a model of stages with the parameters expected before any bench.

    Args:
        stages: at least one.
        effects: that act in them.
    """
    return EfficiencyModel(
        stages[0],
        TYPICAL_PARAMETERS,
        effects=tuple(effects),
        other_stages=tuple(stages[1:]),
    )


def _as_floats(stroke: Any, speed: Any, load: Any) -> tuple[float, float, float]:
    """Return numbers of Python and NumPy as floats; NaN for anything else."""
    are_numbers = (
        type(stroke) in _NUMBERS and type(speed) in _NUMBERS and type(load) in _NUMBERS
    )
    if are_numbers or (_is_number(stroke) and _is_number(speed) and _is_number(load)):
        try:
            return float(stroke), float(speed), float(load)
        except OverflowError:
            pass  # an integer beyond any float is out of range too
    return math.nan, math.nan, math.nan


def _is_number(value: Any) -> bool:
    """Whether a value is a number, or an array of numbers without a dimension."""
    if type(value) is np.ndarray:
        return value.ndim == 0 and value.dtype.kind in "fiu"
    return type(value) in _NUMBERS


def _in_range(stroke: float, speed: float, load: float) -> bool:
    """Return whether an operating point is permitted; False for NaN."""
    return (
        -1.0 <= stroke <= 1.0 and _SLOW <= speed <= _FAST and _OVERRUN <= load <= _PULL
    )


def _few_points(
    point: Sequence[Any],
) -> tuple[list[Iterable[float]], tuple[int, ...]] | None:
    """Return columns of plain floats and their shape; None where they are not of that kind.

    Numbers, and arrays and lists of one shape with up to `_FEW` numbers, are; not numbers alone.
    """
    columns = []
    shape: tuple[int, ...] = ()
    for value in point:
        column = _few_numbers(value)
        if column is None:
            return None
        numbers, own_shape = column
        columns.append(numbers)
        if shape and own_shape and own_shape != shape:
            return None
        shape = own_shape or shape
    return (columns, shape) if shape else None


def _few_numbers(value: Any) -> tuple[Iterable[float], tuple[int, ...]] | None:
    """Return up to `_FEW` numbers as plain floats and their shape; None for anything else."""
    kind = type(value)
    if kind in (list, tuple) and len(value) <= _FEW and set(map(type, value)) == _FLOAT:
        # An array of it would take as long as a lookup.
        return value, (len(value),)
    if kind not in _COLUMNS:
        return None
    try:
        array = np.asarray(value)
    except ValueError:  # lists that do not form an array
        return None
    if array.dtype.kind not in "fiu" or array.size > _FEW:
        return None
    if array.ndim == 0:
        return repeat(float(array)), ()
    if kind is not np.ndarray and not holds_numbers(value):
        return None
    return array.ravel().tolist(), array.shape


def _checked_oil(oil_temperature: float | None) -> float | None:
    """Return an oil temperature [deg C] that is in range, or None.

    Raises:
        InputError: it is out of range or no number.
    """
    if oil_temperature is not None:
        ranges.OIL_TEMPERATURE.check(oil_temperature)
    return oil_temperature


def _mask_of(point: Sequence[Any], oil_temperature: Any) -> Any:
    """Return which points are masked, or None where no input is a masked array."""
    mask = None
    for values in (*point, oil_temperature):
        if isinstance(values, np.ma.MaskedArray):
            own = np.ma.getmaskarray(values)
            mask = own if mask is None else mask | own
    return mask


def _filled(point: Sequence[Any], oil_temperature: Any) -> tuple[Any, Any]:
    """Return inputs with values in range where they are masked."""
    filled = []
    for values, instead in zip(
        (*point, oil_temperature), (*_FILLED, 50.0), strict=True
    ):
        if isinstance(values, np.ma.MaskedArray):
            values = values.filled(instead)
        filled.append(values)
    return tuple(filled[:3]), filled[3]


def _spread(mask: Any, values: Array) -> Any:
    return np.broadcast_to(mask, values.shape)


def _plain(values: Any) -> Any:
    """Return a plain number for an array without a dimension."""
    return values if np.ndim(values) else np.asarray(values).item()
