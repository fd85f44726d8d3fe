# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A transmission on a bench: all that the diagnosis has to know of one."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ..diagnosis import Diagnosis, Isolability, diagnose_system, isolability
from ..diagnosis.observations import TRUST_ASSUMED, Observations, Reading, reading_of
from ..diagnosis.system import Axis, BaseParameters, Channel, Points
from ..diagnosis.system import Effect as AnyEffect
from ..errors import InputError
from ..files.bench import BenchSamples
from ..files.columns import read_columns
from ..model.agreement import output_speed_remark
from ..model.domain import Domain
from ..model.model import EfficiencyModel
from ..physics.effects import library
from ..physics.effects.base import Effect
from ..physics.effects.mechanical import GearEfficiency
from ..physics.effects.sensor import EngineTorqueGain
from ..transmission.parameters import (
    PAPER_EFFICIENCY_UNCERTAINTY,
    PARAMETER_NAMES,
    PARAMETER_RANGES,
    PRIOR_MEAN,
    PRIOR_SPREAD,
    HydraulicParameters,
    from_scaled,
    to_scaled,
)
from ..transmission.ranges import (
    BENCH_COLUMNS,
    EFFICIENCY,
    EFFICIENCY_STD,
    ENGINE_SPEED_LIMITS,
    LOAD_TORQUE,
    REQUIRED_COLUMNS,
    RPM,
    OperatingPoints,
)

Array = NDArray[np.float64]

AXES = (
    Axis("displacement_ratio", "-", "displacement ratio", "stroke", 2, 0.001, graded=False,
         told="stroke {0:+.2f}"),
    Axis("engine_speed", "rad/s", "engine speed", "speed [rad/s]", 1, RPM,
         told="{0:.1f} rad/s ({1:.0f} r/min)", second=1.0 / RPM),
    Axis("load_torque", "N m", "load", "load [N m]", 0, 0.2, told="{0:.0f} N m"),
)
OIL_TEMPERATURE = Axis("oil_temperature", "deg C", "oil temperature", "oil [deg C]", 0, 1.0,
                       steered=False)

EFFICIENCY_CHANNEL = Channel("efficiency", "points", 100.0, 2, PAPER_EFFICIENCY_UNCERTAINTY,
                             relative=False, field_spreads=(0.003, 0.01, 0.03),
                             step_spreads=(0.01, 0.03))
# A lost speed is told as a part of the speed, as its noise is.
OUTPUT_SPEED_CHANNEL = Channel("output_speed", "rad/s", 1.0, 2, 0.001, relative=True,
                               field_spreads=(0.001, 0.004, 0.016), step_spreads=(0.01, 0.03))

_ASSUMED = "assumed, 1.12 % (paper, eq. (3))"
_LEAST_DEVIATION = 1e-5  # of the efficiency: a meter resolves no less
_POINT = tuple(axis.name for axis in AXES)

# Possible tests: strokes, speeds and loads.
_GRID = (9, 6, 6)
_LEAST_POWER = 4e3  # W: below, no bench reads efficiency well


class Transmission:
    """A served model as a `diagnosis.system.System`; effects that it has already stay.

    Raises:
        InputError: the formulation is not `power_balance`.
    """

    axes: tuple[Axis, ...] = (*AXES, OIL_TEMPERATURE)
    channels: tuple[Channel, ...] = (EFFICIENCY_CHANNEL, OUTPUT_SPEED_CHANNEL)
    base = BaseParameters(
        PARAMETER_NAMES, PRIOR_MEAN, PRIOR_SPREAD,
        to_scaled(np.array([limits.low for limits in PARAMETER_RANGES])),
        to_scaled(np.array([limits.high for limits in PARAMETER_RANGES])), from_scaled)
    # Systematic gain of the torque meters (paper, section 2.2: 0.12 %), gear efficiency within a
    # production scatter.
    nuisances: tuple[AnyEffect, ...] = (EngineTorqueGain(gain=0.0015), GearEfficiency(loss=0.0005))
    refusal = "ask for a load that the model cannot carry"
    advice = "check load_torque, which is output power / engine speed, and the stage"

    def __init__(self, model: EfficiencyModel) -> None:
        if model.formulation != "power_balance":
            raise InputError("diagnosis needs formulation power_balance, "
                             f"not {model.formulation!r}")
        self.model = model
        present = {(effect.name, effect.form) for effect in model.effects}
        self.library: tuple[AnyEffect, ...] = tuple(
            kind() for kind in library() if (kind.name, kind.form) not in present)

    def _refitted(self, base: Array, effects: Sequence[AnyEffect]) -> EfficiencyModel:
        return replace(self.model, parameters=HydraulicParameters(*from_scaled(base).tolist()),
                       effects=(*self.model.effects, *cast("Sequence[Effect]", effects)))

    def predict(self, base: Array, effects: Sequence[AnyEffect], points: Points) -> Array:
        """Return efficiency [-] and output speed [rad/s] as the bench reads them, (2, n)."""
        return np.stack(self._refitted(base, effects).answer_at(OperatingPoints(**points)))

    def candidates(self, points: Points, base: Array) -> Points:
        """Return the working range of engine and campaign, as far as it can be carried."""
        measured = points["engine_speed"]
        stroke, speed, part = (axis.ravel() for axis in np.meshgrid(
            np.linspace(-1.0, 1.0, _GRID[0]),
            np.linspace(min(ENGINE_SPEED_LIMITS[0], measured.min()),
                        max(ENGINE_SPEED_LIMITS[1], measured.max()), _GRID[1]),
            np.linspace(0.0, 1.0, _GRID[2]), indexing="ij"))
        lowest = np.maximum(_LEAST_POWER / speed, LOAD_TORQUE.low)
        highest = max(points["load_torque"].max(), 2.0 * _LEAST_POWER / speed.min())
        torque = lowest + part * (highest - lowest)
        possible = {name: np.full(len(speed), np.median(points[name])) for name in points}
        possible.update(zip(_POINT, (stroke, speed, torque), strict=True))
        # NaN is no answer, and is not contained.
        usable = EFFICIENCY.contains(self.predict(base, (), possible)[0])
        return {name: values[usable] for name, values in possible.items()}

    def model_of(
        self, base: Array, effects: Sequence[AnyEffect], samples: BenchSamples
    ) -> EfficiencyModel:
        """Return the model refitted to samples, with effects added."""
        return replace(
            self._refitted(base, effects), standard_errors={}, correlation=None,
            domain=Domain.of(samples),
            provenance={"source": "hmcvt diagnose", "data": samples.source.rsplit("/", 1)[-1],
                        "data_sha256": samples.sha256, "samples": len(samples)})

    def remarks(self, samples: BenchSamples) -> tuple[str, ...]:
        """Say what is odd about the output speed, and what missing columns cost."""
        remarks = [output_speed_remark(self.model.stage, samples)]
        if samples.output_speed is None:
            remarks.append("without column output_speed, losses of flow and of torque look alike")
        if samples.oil_temperature is None:
            remarks.append("without column oil_temperature, viscosity cannot be judged")
        return tuple(filter(None, remarks))


def observe(samples: BenchSamples, noise: float | None = None) -> Observations:
    """Set up the channels that bench samples hold.

    Args:
        samples: bench samples.
        noise: standard deviation of the efficiency [-]; None takes `efficiency_std`, else repeated
            points, else the paper's 1.12 %.

    Raises:
        InputError: `noise` is out of range.
    """
    if noise is not None:
        noise = float(EFFICIENCY_STD.check(noise, "noise"))
    axes = AXES if samples.oil_temperature is None else (*AXES, OIL_TEMPERATURE)
    points = {axis.name: getattr(samples, axis.name) for axis in axes}
    stated = samples.efficiency_std
    first, source = reading_of(
        EFFICIENCY_CHANNEL, samples.efficiency, noise,
        None if stated is None else np.maximum(stated, _LEAST_DEVIATION), axes, points)
    readings = [first]
    if (speed := samples.output_speed) is not None:
        readings.append(Reading(OUTPUT_SPEED_CHANNEL, speed,
                                OUTPUT_SPEED_CHANNEL.uncertainty * speed, TRUST_ASSUMED))
    return Observations(axes, points, tuple(readings), samples, np.arange(len(samples)),
                        source or _ASSUMED, source is None)


def diagnose(
    model: EfficiencyModel,
    samples: BenchSamples,
    holdout: BenchSamples | None = None,
    *,
    noise: float | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Diagnose the gap between a model and a bench.

    The base parameters of `model` are refitted first: a gap that a refit closes is no gap.

    Args:
        model: formulation `power_balance`; effects it already has stay.
        samples: at least five bench samples; output speed and oil temperature are used if there.
        holdout: samples to measure the shrinkage on, with their own noise if they state any; None
            for cross-validation.
        noise: standard deviation of the efficiency [-]; None takes column `efficiency_std`,
            repeated points, or the paper's 1.12 %, in this order.
        seed: of every random number.
        progress: called with a line of text before each step; may raise to cancel.

    Raises:
        InputError: samples cannot carry a diagnosis, the holdout lacks a column or holds
            nothing new, or the formulation is another.
    """
    system, notes = Transmission(model), []
    told = list(zip(_rows(samples, [item.name for item in BENCH_COLUMNS]),
                    *samples.extra.values(), strict=True))
    # The first of equal rows. A copy says nothing new, least of all about the noise, as readings
    # repeated at one point do.
    first = {row: i for i, row in reversed(list(enumerate(told)))}
    rows = np.array(sorted(first.values()))
    observed = replace(observe(samples.select(rows), noise), number=rows)
    if len(rows) < len(samples):
        notes.append(f"{len(samples) - len(rows)} of {len(samples)} rows copy another one in every "
                     "column and were left out")
    held = None if holdout is None else _fresh(holdout, samples, notes)
    return diagnose_system(system, observed, held, notes=notes, seed=seed, progress=progress)


def _rows(samples: BenchSamples, names: Iterable[str]) -> list[tuple[object, ...]]:
    columns = [getattr(samples, name) for name in names]
    return list(zip(*(each.tolist() for each in columns if each is not None), strict=True))


def _fresh(holdout: BenchSamples, samples: BenchSamples, notes: list[str]) -> Observations:
    """Leave out what the diagnosis has seen already, and note so."""
    if holdout.oil_temperature is None and samples.oil_temperature is not None:
        raise InputError(f"{holdout.source}: column oil_temperature is missing; {samples.source} "
                         "has it")
    seen = set(_rows(samples, REQUIRED_COLUMNS))
    kept = np.array([i for i, row in enumerate(_rows(holdout, REQUIRED_COLUMNS))
                     if row not in seen], dtype=np.intp)
    if not len(kept):
        raise InputError(f"{holdout.source}: every sample held out is among those diagnosed; a "
                         "holdout is measured apart, or leave it out for cross-validation")
    if len(kept) < len(holdout):
        notes.append(f"{len(holdout) - len(kept)} of {len(holdout)} samples held out are among "
                     "those diagnosed and were left out")
    return replace(observe(holdout.select(kept)), number=kept)


def separable(
    model: EfficiencyModel,
    plan: BenchSamples,
    *,
    noise: float | None = None,
) -> Isolability:
    """Tell which effects a set of operating points can show and tell apart.

    Args:
        model: formulation `power_balance`; supplies the base parameters.
        plan: operating points; the efficiency in it is not used, the presence of output speed
            and oil temperature is.
        noise: standard deviation of the efficiency [-]; None as in `diagnose`.
    """
    system, observed, fuller = Transmission(model), observe(plan, noise), None
    if plan.output_speed is None:
        speed = model.answer_at(OperatingPoints(**observed.points)).output_speed
        fuller = observe(replace(plan, output_speed=speed), noise)
    return isolability(system, observed, to_scaled(model.parameters.to_array()), fuller)


def read_plan(
    path: str | os.PathLike[str], model: EfficiencyModel, output_speed: bool = False
) -> BenchSamples:
    """Read operating points and fill in what a model expects to be read there.

    Args:
        path: CSV as for `read_bench`; column `efficiency` may be missing and is not used.
        model: supplies efficiency and output speed.
        output_speed: whether the output speed will be read; a column of that name says so too.

    Raises:
        InputError: as `read_bench`, or the model has no answer at a point.
    """
    known, extra, found = read_columns(path, _POINT)
    points = OperatingPoints(
        **{axis: known[axis] for axis in OperatingPoints._fields if axis in known})
    known["efficiency"], read_speed = model.answer_at(points)
    stalled = np.flatnonzero(np.isnan(known["efficiency"]))
    if len(stalled):
        raise InputError(f"{path}: row {found.rows[stalled[0]]}: load_torque = "
                         f"{points.load_torque[stalled[0]]:g} cannot be carried there")
    if output_speed or "output_speed" in known:
        known["output_speed"] = read_speed
    return BenchSamples(**known, extra=extra, source=found.source, sha256=found.sha256)
