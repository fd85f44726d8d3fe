# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The estimate at every row of a log: output torque and power, losses, and their intervals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.errors import InputError
from hmcvt_core.files.atomic import growing_file
from hmcvt_core.model.engine import Engine
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.transmission.ranges import ENGINE_SPEED, RPM, Array

from ..logs.joining import Joined
from ..logs.selection import ENGAGED, TAKE_OFFS, Selection
from .condition import Moves, moves
from .intervals import Deviations, Inputs, deviations, rate_of_change
from .settings import EstimateSettings
from .solving import QUANTILE, Solved, Stages, unsolved

STANDING = 5.0 * RPM
"""Output speed below which the output stands [rad/s]: it takes no power."""
_TAKE_OFF = 50.0
"""Speed of a power take-off from which it turns [r/min]."""
_IDLE = ENGINE_SPEED.low
_SECOND_STAGE = 0.5
"""Standard deviation, in the difference between two stages that may both be engaged."""
_STATED_STAGE = 1.0
"""The same where the bus names one of them: the interval then holds the load of the other, too."""
_SAME_STROKE = 0.05
"""Measured and solved displacement ratio differ by less in the stage engaged, besides what the
errors of the parameters explain."""
_INVERSIONS = 30
"""Bisections for the torque behind a fuel rate."""

STANDSTILL = "standstill"
"""Name of the state in which the output stands or the drive line is open."""


class Rows(NamedTuple):
    """Estimate at the rows of a log, shape (n,) each; NaN without one.

    Attributes:
        time: [s].
        stage: names; empty where none is known.
        displacement_ratio: [-].
        engine_speed: [rad/s].
        engine_power: into the transmission [W].
        load_torque: output power / engine speed [N m].
        output_torque: [N m].
        output_torque_deviation: standard deviation [N m].
        output_power: [W].
        deviations: of the output power [W].
        reason: why there is no estimate; empty where there is one.
    """

    time: Array
    stage: NDArray[np.str_]
    displacement_ratio: Array
    engine_speed: Array
    engine_power: Array
    load_torque: Array
    output_torque: Array
    output_torque_deviation: Array
    output_power: Array
    deviations: Deviations
    reason: NDArray[np.str_]

    @property
    def power_loss(self) -> Array:
        """Engine power less output power [W]."""
        return np.asarray(self.engine_power - self.output_power)

    @property
    def efficiency(self) -> Array:
        """Output power / engine power [-]; NaN where one of them is not positive."""
        pulls = (self.engine_power > 0.0) & (self.output_power > 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(pulls, self.output_power / self.engine_power, np.nan)

    @property
    def output_torque_interval(self) -> tuple[Array, Array]:
        """Interval of the output torque at 90 % [N m]."""
        half = QUANTILE * self.output_torque_deviation
        return self.output_torque - half, self.output_torque + half

    @property
    def output_power_interval(self) -> tuple[Array, Array]:
        """Interval of the output power at 90 % [W]."""
        half = QUANTILE * self.deviations.power
        return self.output_power - half, self.output_power + half


@dataclass(frozen=True)
class Estimator:
    """Estimates rows with one model and one choice of channels.

    Attributes:
        model: of the transmission.
        stages: its solvers.
        engine: for the torque behind a fuel rate; None where the torque is known.
        selection: channels of the log.
        settings: errors of the bus.
        source: name of the log, for messages.
    """

    model: EfficiencyModel
    stages: Stages
    engine: Engine | None
    selection: Selection
    settings: EstimateSettings
    source: str

    def rows(self, joined: Joined, values: Mapping[str, Any]) -> Rows:
        """Return the estimate at joined rows.

        Args:
            joined: signals, for states of the drive line.
            values: SI values by quantity.

        Raises:
            InputError: the log names a stage that the model does not have.
        """
        time = joined.time
        speed = values["engine_speed"]
        torque, gross = self._torques(values)
        output = self._signed_output(values)
        net = torque - self.settings.engine_inertia * rate_of_change(time, speed)
        hydraulics, _ = self.settings.hydraulics
        net = net - hydraulics / np.maximum(speed, _IDLE)
        inputs = Inputs(time, speed, output, net, gross)
        reason = self._reasons(joined, inputs)
        standing = (reason == "") & self._stands(joined, output)
        temperature = values.get("oil_temperature")
        engaged = self._engaged(
            inputs, values, np.flatnonzero((reason == "") & ~standing), temperature
        )
        unsolved = np.isnan(engaged.solved.load_torque) & ~standing & (reason == "")
        reason = np.where(unsolved, "no stage of the model fits", reason)
        if "stage" in values:
            stated = unsolved & (values["stage"] != "")
            reason = np.where(stated, "the stated stage does not fit", reason)
        moved = moves(self.model, engaged.solved, temperature, self.settings)
        load = engaged.solved.load_torque + moved.load
        engaged = engaged._replace(solved=engaged.solved._replace(load_torque=load))
        return self._assembled(inputs, engaged, moved, standing, reason)

    def _torques(self, values: Mapping[str, Any]) -> tuple[Array, Array]:
        """Torque at the flywheel, and with the friction of the engine where it is known [N m]."""
        if "engine_torque" in values:
            torque = np.asarray(values["engine_torque"])
            bus = self.selection.torque
            gross = np.abs(torque)
            if bus is not None:
                friction = 0.1 if bus.friction is None else 0.01 * bus.friction
                gross = gross + friction * bus.reference
            return torque, gross
        if "engine_power" in values:
            torque = np.asarray(values["engine_power"] / values["engine_speed"])
            return torque, np.abs(torque)
        if self.engine is None:
            raise InputError(f"{self.source}: a fuel rate needs the engine (--engine)")
        torque = torque_of_fuel(
            self.engine, values["engine_speed"], values["fuel_rate"]
        )
        return torque, np.abs(torque)

    @property
    def bias(self) -> float:
        """Standard deviation of the bias of the torque, a fraction."""
        if {"engine_torque", "engine_power"} & self.selection.quantities:
            return self.settings.torque_bias
        return self.settings.fuel_bias

    def _signed_output(self, values: Mapping[str, Any]) -> Array:
        """Output speed; that of a bus has no sign, and a reverse stage turns backward."""
        output = np.asarray(values["output_speed"], dtype=float)
        if "stage" not in values:
            return output
        self.stages.require_known(values["stage"], self.source)
        backward = np.zeros(len(output), dtype=bool)
        for name, solver in self.stages.solvers.items():
            if solver.reach[1] <= 0.0:
                backward |= values["stage"] == name
        return np.where(backward, -np.abs(output), output)

    def _reasons(self, joined: Joined, inputs: Inputs) -> NDArray[np.str_]:
        """Why rows have no estimate, before any is tried."""
        conditions = {
            "no engine torque": ~np.isfinite(inputs.engine_torque),
            "no output speed": ~np.isfinite(inputs.output_speed),
            "no engine speed": ~np.isfinite(inputs.engine_speed),
            "the engine stands": inputs.engine_speed < _IDLE,
            "engine speed out of range": inputs.engine_speed > ENGINE_SPEED.high,
        }
        for name in TAKE_OFFS:
            if name in joined.values:
                turning = joined.values[name] > _TAKE_OFF
                conditions["the power take-off turns"] = turning | conditions.get(
                    "the power take-off turns", False
                )
        reason = np.full(len(joined.time), "", dtype="U40")
        for text, where in conditions.items():
            reason[where] = text
        return reason

    def _stands(self, joined: Joined, output: Array) -> NDArray[np.bool_]:
        stands = np.abs(output) < STANDING
        if ENGAGED in joined.values and joined.values[ENGAGED].dtype.kind == "U":
            stands |= joined.values[ENGAGED] == "off"
        return np.asarray(stands)

    def _engaged(
        self,
        inputs: Inputs,
        values: Mapping[str, Any],
        rows: NDArray[np.intp],
        oil_temperature: Array | None,
    ) -> _Engaged:
        """Return loads and stages at some rows, NaN and -1 elsewhere."""
        count = len(inputs.time)
        at = Inputs(*(column[rows] for column in inputs))
        stroke = values.get("displacement_ratio")
        stated = values.get("stage")
        is_stated = np.zeros(len(rows), dtype=bool)
        if stated is not None:
            is_stated = stated[rows] != ""
        first, second = self.stages.engaged(
            at.output_speed / at.engine_speed,
            None if stroke is None else stroke[rows],
            None if stated is None else stated[rows],
        )
        oil = None if oil_temperature is None else oil_temperature[rows]
        likely = self._solve(at, first, oil)
        other = self._solve(at, second, oil)
        better = np.isnan(likely.load_torque) & np.isfinite(other.load_torque)
        better &= ~is_stated
        measured = np.full(len(rows), np.nan) if stroke is None else stroke[rows]
        fits, misses = _agrees(likely, measured)
        other_fits, other_misses = _agrees(other, measured)
        # The bus contradicts itself: its displacement ratio is that of another stage.
        refuted = is_stated & misses & other_fits
        likely = likely._replace(
            load_torque=np.where(refuted, np.nan, likely.load_torque)
        )
        is_certain = is_stated & fits & other_misses
        solved = self._unsolved(count)
        for column, one, two in zip(solved, likely, other, strict=True):
            column[..., rows] = np.where(better, two, one)
        stage = np.full(count, -1)
        stage[rows] = np.where(better, second, first)
        apart = np.nan_to_num(np.abs(likely.load_torque - other.load_torque))
        part = np.where(is_stated, _STATED_STAGE, _SECOND_STAGE)
        deviation = np.zeros(count)
        deviation[rows] = np.where(is_certain, 0.0, part * apart)
        return _Engaged(solved, stage, deviation)

    def _unsolved(self, count: int) -> Solved:
        """Return a result without any load."""
        errors = 3 if self.model.states_errors else 0
        return unsolved(count, errors)

    def _solve(
        self, at: Inputs, stage: NDArray[np.intp], oil_temperature: Array | None
    ) -> Solved:
        """Return loads at rows with the stage of each by number; NaN for -1."""
        solved = self._unsolved(len(stage))
        for number, solver in enumerate(self.stages.solvers.values()):
            (rows,) = np.nonzero(stage == number)
            if len(rows):
                part = solver.solve(
                    at.engine_speed[rows],
                    at.output_speed[rows],
                    at.engine_torque[rows],
                    None if oil_temperature is None else oil_temperature[rows],
                )
                for column, values in zip(solved, part, strict=True):
                    column[..., rows] = values
        return solved

    def _assembled(
        self,
        inputs: Inputs,
        engaged: _Engaged,
        moved: Moves,
        standing: NDArray[np.bool_],
        reason: NDArray[np.str_],
    ) -> Rows:
        """Return the estimate from loads, stages and rows in which the output stands."""
        solved = engaged.solved
        answered = reason == ""
        engine_power = np.where(
            answered, inputs.engine_torque * inputs.engine_speed, np.nan
        )
        power = solved.load_torque * inputs.engine_speed
        power = np.where(standing, 0.0, power)
        spread = deviations(
            inputs,
            solved,
            self.model.correlation if self.model.states_errors else None,
            dict(self.selection.resolution),
            self.settings,
            self.bias,
            moved,
            self.model.degrees_of_freedom,
        )
        ambiguous = engaged.load_deviation * inputs.engine_speed
        passing = np.hypot(spread.passing, ambiguous)
        spread = Deviations(
            np.where(standing, 0.0, spread.lasting),
            np.where(standing, 0.0, passing),
            spread.output_speed,
        )
        output = np.where(standing, np.nan, inputs.output_speed)
        with np.errstate(divide="ignore", invalid="ignore"):
            output_torque = power / output
            relative = np.abs(output_torque) * spread.output_speed / np.abs(output)
            deviation = np.hypot(spread.power / np.abs(output), relative)
        names = np.array([*self.stages.names, ""])
        stage = np.where(standing, STANDSTILL, names[engaged.stage])
        return Rows(
            inputs.time,
            np.where(answered, stage, ""),
            solved.displacement_ratio,
            inputs.engine_speed,
            engine_power,
            solved.load_torque,
            output_torque,
            deviation,
            np.where(answered, power, np.nan),
            spread,
            reason,
        )


class _Engaged(NamedTuple):
    """Loads, the stage of each row by number, and what a second stage leaves open [N m]."""

    solved: Solved
    stage: NDArray[np.intp]
    load_deviation: Array


def _agrees(
    solved: Solved, measured: Array
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return where solved displacement ratios agree with measured ones, and where they do not.

    Neither where one of them is not known. Shape (n,) each.
    """
    miss = np.abs(solved.displacement_ratio - measured)
    deviation = np.nan_to_num(solved.stroke_deviation)
    allowed = _SAME_STROKE + QUANTILE * deviation
    return miss <= allowed, miss > allowed


def torque_of_fuel(engine: Engine, engine_speed: Array, fuel_rate: Array) -> Array:
    """Return the torque that takes a fuel rate [N m]; NaN beyond the map.

    Args:
        engine: with a fuel map that rises with the torque.
        engine_speed: [rad/s], shape (n,).
        fuel_rate: [kg/s], shape (n,).
    """
    low = np.zeros(len(engine_speed))
    high = np.asarray(engine.full_load_torque(engine_speed), dtype=float)
    idle = engine.fuel_rate(engine_speed, low)
    full = engine.fuel_rate(engine_speed, high)
    # Within the error of a fuel meter beyond both ends.
    possible = (fuel_rate >= 0.9 * idle) & (fuel_rate <= 1.1 * full)
    for _ in range(_INVERSIONS):
        middle = 0.5 * (low + high)
        below = engine.fuel_rate(engine_speed, middle) < fuel_rate
        low = np.where(below, middle, low)
        high = np.where(below, high, middle)
    return np.where(possible, 0.5 * (low + high), np.nan)


class SeriesFile:
    """Writes rows to a CSV file; an interrupted run leaves the old file.

    Args:
        path: of the file.
    """

    def __init__(self, path: Path) -> None:
        self._growing = growing_file(path)
        self._has_header = False

    def __enter__(self) -> SeriesFile:
        self._file = self._growing.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._growing.__exit__(*error)

    def write(self, rows: Rows) -> None:
        """Append rows; those without an estimate hold a stamp and an engine speed alone."""
        import pandas

        low, high = rows.output_torque_interval
        frame = pandas.DataFrame(
            {
                "stamp": rows.time,
                "stage": rows.stage,
                "displacement_ratio": rows.displacement_ratio,
                "engine_speed": rows.engine_speed,
                "output_torque": rows.output_torque,
                "output_torque_low": low,
                "output_torque_high": high,
                "output_power": rows.output_power,
                "power_loss": rows.power_loss,
                "efficiency": rows.efficiency,
            }
        )
        numbers = frame.columns.drop(["stamp", "stage"])
        frame[numbers] = frame[numbers].astype("float32")
        frame.to_csv(
            self._file, index=False, header=not self._has_header, lineterminator="\n"
        )
        self._has_header = True
