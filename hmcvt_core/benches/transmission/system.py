# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The served model of a transmission as a `System` of the diagnosis."""

import os
from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, cast

import numpy as np

from ...diagnosis.observations import SESSION
from ...diagnosis.system import Array, Axis, Case, Channel, Points, Unrecorded
from ...diagnosis.system import Effect as AnyEffect
from ...errors import InputError
from ...files.bench import BenchSamples
from ...model.domain import Domain
from ...model.model import EfficiencyModel
from ...physics.balance import BalanceSolver
from ...physics.effects import library
from ...physics.effects.base import Effect, Value
from ...physics.effects.by_row import by_row
from ...transmission import ranges
from ...transmission.parameters import Candidates
from ...transmission.stage import Stage
from .base import base_parameters, base_values, hydraulic_errors, refitted_errors
from .channels import (
    AXES,
    CHANNELS,
    DISPLACEMENT_RATIO,
    ENGINE_SPEED,
    LOAD_TORQUE,
    OIL_TEMPERATURE,
    STAGE,
    by_name,
)
from .unrecorded import unrecorded

STANDSTILL = 0.02
"""Stroke around motor standstill where friction changes its sense [-].

Makers ask for 50 r/min where a motor has to run evenly (Bosch Rexroth, RA 91001): this stroke at
2500 r/min.
"""
CANDIDATE_STROKES = 9
CANDIDATE_SPEEDS = 6
CANDIDATE_LOADS = 6
"""Grid of candidate tests along each axis; chosen on development campaigns."""
MAX_VALUES = 2048
"""Values of one quantity that are solved together; more leave the cache of the processor."""
MIN_POWER = 4e3
"""Output power below which benches read the efficiency poorly [W]; chosen for candidate tests."""

MIN_OUTPUT_FRACTION = 0.1
"""Fraction of the usual output speed of a stage below which a test is too near the reversal.

Source: chosen. Where the output nearly stands still, small errors of the stroke decide its sign.
"""
HIGHEST_PRESSURE = 45e6
"""Highest pressure of a test unless the campaign has a higher one [Pa].

Source: maximum pressure of axial piston units for closed circuits (Bosch Rexroth, RA 92003: A4VG,
nominal 400 bar, maximum 450 bar).
"""


class Transmission:
    """A served model as a `System`; the effects that the model has already stay in it.

    Args:
        model: formulation `power_balance`.
        read: names of the columns that the bench reads; the gauges of the channels among them are
            refitted.

    Raises:
        InputError: the formulation is not `power_balance`.
    """

    axes: tuple[Axis, ...] = (*AXES, OIL_TEMPERATURE, STAGE)
    channels: tuple[Channel, ...] = CHANNELS
    refusal = "ask for a load that the model cannot carry"
    advice = "check load_torque, which is output power / engine speed, and the stage"

    def __init__(self, model: EfficiencyModel, read: Collection[str] = ()) -> None:
        if model.formulation != "power_balance":
            raise InputError(
                f"diagnosis needs formulation power_balance, not {model.formulation!r}"
            )
        self.model = model
        stages = (model.stage, *model.other_stages)
        if all(stage.layout == "input_coupled" for stage in stages):
            # Only in this layout does the motor stand still at a stroke that is known: zero.
            stroke = replace(DISPLACEMENT_RATIO, transition_width=STANDSTILL)
            self.axes = (stroke, ENGINE_SPEED, LOAD_TORQUE, OIL_TEMPERATURE, STAGE)
        self.base = base_parameters(read)
        self._gauges = refitted_errors(read)
        self.library: tuple[AnyEffect, ...] = _missing_effects(model, read)

    def _refitted(self, base: Array, effects: Sequence[AnyEffect]) -> EfficiencyModel:
        values = base_values(self.base, base)
        return replace(
            self.model,
            stage=_with_gear_loss(self.model.stage, values.gear_loss),
            other_stages=tuple(
                _with_gear_loss(stage, values.gear_loss)
                for stage in self.model.other_stages
            ),
            parameters=values.hydraulics,
            effects=(*self.model.effects, *cast("Sequence[Effect]", effects)),
        )

    def predict(
        self, base: Array, effects: Sequence[AnyEffect], points: Points
    ) -> Array:
        """Return every channel as read, in SI units.

        Args:
            base: scaled base parameters, shape (p,).
            effects: added to those of the model.
            points: operating points, n values along each axis.

        Returns:
            Shape (channels, n), in the order of `CHANNELS`; NaN where the model has no answer.
        """
        return np.asarray(self.predict_cases([(base, effects)], points)[0])

    def predict_cases(self, cases: Sequence[Case], points: Points) -> Array:
        """Return the readings of many cases, as `predict` those of one; (cases, channels, n)."""
        at_once = max(1, MAX_VALUES // max(1, len(points[ENGINE_SPEED.name])))
        parts = []
        for start in range(0, len(cases), at_once):
            parts.append(self._solved(cases[start : start + at_once], points))
        return np.concatenate(parts)

    def _solved(self, cases: Sequence[Case], points: Points) -> Array:
        """Return the readings of cases solved together, shape (cases, channels, n)."""
        values = [base_values(self.base, base) for base, _ in cases]
        hydraulics = [value.hydraulics for value in values]
        parameters = Candidates(
            _by_case([value.leakage for value in hydraulics]),
            _by_case([value.motor_damping for value in hydraulics]),
            _by_case([value.pump_damping for value in hydraulics]),
        )
        gear_loss = _by_case([value.gear_loss for value in values])
        added = by_row([cast("Sequence[Effect]", effects) for _, effects in cases])

        def readings(name: str | None, at: ranges.OperatingPoints) -> Sequence[Array]:
            stage = _with_gear_loss(self.model.in_stage(name).stage, gear_loss)
            effects = (*self.model.effects, *added)
            solver = BalanceSolver(stage, parameters, effects)
            shape = (len(cases), at.engine_speed.size)
            read = solver.readings(at.map(lambda row: np.broadcast_to(row, shape)))
            return [read[channel.name] for channel in self.channels]

        solved = by_name(self._operating_points(points).solved(readings))
        for error in self._gauges:
            size = _by_case([value.gauges[error.name] for value in values])
            true = solved[error.channel]
            solved[error.channel] = (
                true + size if error.is_zero else true * (1.0 + size)
            )
        return np.stack(list(solved.values()), axis=1)

    def _operating_points(self, points: Points) -> ranges.OperatingPoints:
        """Return points as the physics takes them, with the names of their stages."""
        known: dict[str, Any] = {**points}
        known.pop(SESSION, None)
        if STAGE.name in known:
            stages = np.array(list(self.model.stages))
            known[STAGE.name] = stages[known[STAGE.name].astype(int)]
        return ranges.OperatingPoints(**known)

    def candidates(self, points: Points, base: Array) -> Points:
        """Return tests over the working range of engine and campaign that the machine can carry.

        The model has an answer, the output turns as in the campaign and not too slowly, and the
        pressure is one that units carry.

        Args:
            points: operating points measured so far.
            base: scaled base parameters, shape (p,).
        """
        possible = _with_every_stage(_grid(points), points)
        measured = by_name(self.predict(base, (), points))
        predicted = by_name(self.predict(base, (), possible))
        highest = np.nanmax(np.abs(measured["pressure"]), initial=HIGHEST_PRESSURE)
        usual = _usual_in_stage(measured["output_speed"], points, possible)
        output_speed = predicted["output_speed"] * np.sign(usual)
        # NaN, no answer, is not contained.
        usable = (
            ranges.EFFICIENCY.contains(predicted["efficiency"])
            & (np.abs(predicted["pressure"]) <= highest)
            & (output_speed >= MIN_OUTPUT_FRACTION * np.abs(usual))
        )
        return {name: values[usable] for name, values in possible.items()}

    def lost_power(self, points: Points, expected: Array, real: Array) -> Array:
        """Return the engine power that an efficiency below the expected one costs [W].

        Args:
            points: operating points.
            expected: efficiency of the reference [-], shape (n,).
            real: efficiency to compare [-], shape (n,).

        Returns:
            Shape (n,); negative where the efficiency is higher.
        """
        output_power = points[LOAD_TORQUE.name] * points[ENGINE_SPEED.name]
        return output_power * (1.0 / real - 1.0 / expected)

    def model_of(
        self,
        base: Array,
        effects: Sequence[AnyEffect],
        samples: BenchSamples,
        covariance: Array | None = None,
    ) -> EfficiencyModel:
        """Return the model refitted to samples, with effects added.

        Args:
            base: scaled base parameters, shape (p,).
            effects: at their fitted sizes.
            samples: to which they were fitted.
            covariance: of the scaled base parameters, shape (p, p); None leaves the model without
                standard errors.
        """
        errors: dict[str, float] = {}
        correlation = None
        if covariance is not None:
            errors, correlation = hydraulic_errors(base, covariance)
        return replace(
            self._refitted(base, effects).with_errors(errors, correlation),
            domain=Domain.of(samples),
            units={},
            misfit=0.0,
            remainder_deviation=0.0,
            provenance={
                "source": "hmcvt diagnose",
                "data": os.path.basename(samples.source),
                "data_sha256": samples.sha256,
                "samples": len(samples),
            },
        )

    def unrecorded(self, base: Array, points: Points) -> Sequence[Unrecorded]:
        """Return the quantities that may vary although no column records them."""
        return unrecorded(self, base, points)

    def remarks(self, samples: BenchSamples) -> tuple[str, ...]:
        """Return notes on what missing columns cost."""
        return tuple(
            f"without column {column.name}, {column.missing}"
            for column in ranges.BENCH_COLUMNS
            if column.missing and getattr(samples, column.name) is None
        )


# A refit perturbs the gear loss in one of its steps and leaves it in all others.
_with_known_gear_loss = lru_cache(maxsize=64)(Stage.with_gear_loss)


def _with_gear_loss(stage: Stage, loss: Value) -> Stage:
    """Return a stage with a gear loss: a number, or one for each case."""
    if isinstance(loss, float):
        return _with_known_gear_loss(stage, loss)
    return stage.with_gear_loss(loss)


def _by_case(values: Sequence[float]) -> Value:
    """Return values of cases: the number if all have the same, else shape (cases, 1)."""
    if len(set(values)) == 1:
        return values[0]
    return np.array(values)[:, None]


def _missing_effects(
    model: EfficiencyModel, read: Collection[str]
) -> tuple[AnyEffect, ...]:
    """Return the listed effects that a model has not, as far as the columns can show them."""
    present = {(effect.name, effect.form) for effect in model.effects}
    kinds = shown_by(model, read)
    return tuple(kind() for kind in kinds if (kind.name, kind.form) not in present)


def shown_by(model: EfficiencyModel, read: Collection[str]) -> list[type[Effect]]:
    """Return the listed effects that columns of these names can show on a transmission."""
    has_oil_temperature = OIL_TEMPERATURE.name in read
    # In one input-coupled stage a clutch ahead of the row slips as one at the output does.
    is_apart = bool(model.other_stages) or model.stage.layout == "output_coupled"
    return [
        kind
        for kind in library()
        if (has_oil_temperature or not kind.needs_oil_temperature)
        and (is_apart or not kind.acts_at("mechanical_slip"))
    ]


def _grid(points: Points) -> dict[str, Array]:
    """Candidate tests at the median of every axis that a test does not set."""
    measured = points[ENGINE_SPEED.name]
    strokes = np.linspace(-1.0, 1.0, CANDIDATE_STROKES)
    speeds = np.linspace(
        min(ranges.ENGINE_SPEED_LIMITS[0], measured.min()),
        max(ranges.ENGINE_SPEED_LIMITS[1], measured.max()),
        CANDIDATE_SPEEDS,
    )
    parts = np.linspace(0.0, 1.0, CANDIDATE_LOADS)
    grid = np.meshgrid(strokes, speeds, parts, indexing="ij")
    stroke, speed, part = (values.ravel() for values in grid)
    lowest = np.maximum(MIN_POWER / speed, ranges.LOAD_TORQUE.low)
    highest = max(points[LOAD_TORQUE.name].max(), 2.0 * MIN_POWER / speed.min())
    possible = {
        name: np.full(len(speed), np.median(values)) for name, values in points.items()
    }
    possible[DISPLACEMENT_RATIO.name] = stroke
    possible[ENGINE_SPEED.name] = speed
    possible[LOAD_TORQUE.name] = lowest + part * (highest - lowest)
    return possible


def _with_every_stage(possible: dict[str, Array], points: Points) -> dict[str, Array]:
    """Repeat candidate tests in each stage in which the campaign has samples."""
    if STAGE.name not in points:
        return possible
    stages = np.unique(points[STAGE.name])
    count = len(possible[ENGINE_SPEED.name])
    repeated = {name: np.tile(values, len(stages)) for name, values in possible.items()}
    repeated[STAGE.name] = np.repeat(stages, count)
    return repeated


def _usual_in_stage(measured: Array, points: Points, possible: Points) -> Array:
    """Return the median of a reading over the campaign in the stage of each possible test.

    Args:
        measured: at the points of the campaign, shape (n,).
        points: of the campaign.
        possible: tests in the stages of the campaign, m of them.

    Returns:
        Shape (m,).
    """
    count = len(possible[ENGINE_SPEED.name])
    if STAGE.name not in points:
        return np.full(count, np.nanmedian(measured))
    usual = np.empty(count)
    for stage in np.unique(points[STAGE.name]):
        in_stage = points[STAGE.name] == stage
        usual[possible[STAGE.name] == stage] = np.nanmedian(measured[in_stage])
    return usual
