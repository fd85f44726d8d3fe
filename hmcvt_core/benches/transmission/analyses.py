# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What can be asked of a model and its bench: diagnosis, next test, and what a plan can show."""

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...diagnosis import Advice, Diagnosis, Isolability, diagnose_system, isolability
from ...diagnosis import next_test as next_test_of_system
from ...diagnosis.observations import SESSION, Observations
from ...diagnosis.system import Points
from ...errors import InputError
from ...files.bench import BenchSamples, read_columns
from ...files.checks import one_holdout, require_seed
from ...model.checks import require_model_and_samples, require_samples
from ...model.model import EfficiencyModel
from ...model.oil import oil_remarks
from ...model.plausibility import gear_train_remarks, pressure_remark
from ...model.signs import require_signs
from ...model.staged_samples import stage_of_each
from .base import scaled_base
from .change import diagnose_change
from .channels import AXES, CHANNELS
from .meters import with_meter_errors
from .misfit import with_misfits
from .readings import distinct_observations, held_out_observations, observe
from .served import with_served_model
from .system import Transmission


def diagnose(
    model: EfficiencyModel,
    samples: BenchSamples,
    holdout: BenchSamples | None = None,
    *,
    noise: float | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    validation: BenchSamples | None = None,
    baseline: BenchSamples | None = None,
) -> Diagnosis:
    """Diagnose the gap between a model and a bench.

    The base parameters of `model` are refitted first: a gap that a refit closes is no gap.

    Args:
        model: formulation `power_balance`; effects it already has stay.
        samples: at least five bench samples; output speed, pressure and oil temperature are used
            where the samples have them.
        holdout: held-out samples to measure the shrinkage on, with their noise if they state
            it; None for cross-validation.
        noise: standard deviation of the efficiency [-]; None takes column `efficiency_std`,
            repeated points, or the paper's 1.12 %, in this order.
        seed: of every random number.
        progress: called with a line of text before each step; may raise to cancel.
        validation: former name of `holdout`.
        baseline: the same transmission when it was sound, or a sister; it is fitted first and
            held, and only what has changed since is diagnosed. At least sixteen samples.

    Returns:
        The diagnosis; `report()` prints it, `to_dict()` is the object of `hmcvt diagnose --json`.

    Raises:
        InputError: samples cannot carry a diagnosis, the holdout lacks a column or holds
            nothing new, the formulation is another, or the baseline is of another machine or too
            small.
    """
    holdout = one_holdout(holdout, validation)
    require_model_and_samples(model, samples, holdout)
    require_seed(seed)
    stages = list(model.stages)
    warnings = _warnings(model, samples)
    if baseline is not None:
        require_samples(baseline, "baseline")
        require_signs(model, baseline)
        return diagnose_change(
            model,
            samples,
            baseline,
            holdout,
            noise=noise,
            warnings=warnings,
            seed=seed,
            progress=progress,
        )
    observed, notes = distinct_observations(samples, noise, stages)
    notes += oil_remarks(model, samples)
    held_out = None
    if holdout is not None:
        held_out, more = held_out_observations(holdout, samples, stages)
        notes += more
    system = Transmission(model, samples.columns)
    diagnosis = diagnose_system(
        system,
        with_meter_errors(observed, system),
        held_out,
        warnings=warnings,
        notes=notes,
        seed=seed,
        progress=progress,
    )
    return with_served_model(with_misfits(diagnosis))


def next_test(
    model: EfficiencyModel,
    samples: BenchSamples,
    *,
    noise: float | None = None,
    possible: BenchSamples | None = None,
    seed: int = 0,
) -> Advice:
    """Choose the test of most information on what is still open, or the reason to stop.

    Args:
        model: as of `diagnose`.
        samples: as of `diagnose`.
        noise: as of `diagnose`.
        possible: the tests that can be run (their efficiency is not used); None for the working
            range of engine and campaign.
        seed: of every random number.

    Raises:
        InputError: as `diagnose`.
    """
    require_model_and_samples(model, samples, possible, "possible")
    stages = list(model.stages)
    warnings = _warnings(model, samples)
    observed, notes = distinct_observations(samples, noise, stages)
    notes += oil_remarks(model, samples)
    points = None
    if possible is not None:
        points = _planned_points(possible, observed, noise, stages)
    system = Transmission(model, samples.columns)
    return next_test_of_system(
        system,
        with_meter_errors(observed, system),
        points,
        notes=(*warnings, *notes),
        seed=seed,
    )


def _planned_points(
    plan: BenchSamples,
    observed: Observations,
    noise: float | None,
    stages: Sequence[str],
) -> Points:
    """Operating points of a plan; an axis that it leaves out stays at the campaign's median."""
    planned = observe(plan, noise, stages).points
    points = {}
    for name, measured in observed.points.items():
        if name == SESSION:
            continue
        usual = np.full(len(plan), np.median(measured))
        points[name] = planned.get(name, usual)
    return points


def _warnings(model: EfficiencyModel, samples: BenchSamples) -> list[str]:
    """Return sentences on why the readings may be of another machine.

    Raises:
        InputError: a reading has the wrong sign in a whole stage, or as of `stage_of_each`.
    """
    require_signs(model, samples)
    remarks = gear_train_remarks(model, samples)
    pressure = pressure_remark(model, samples)
    if pressure:
        remarks.append(pressure)
    return remarks


def separable(
    model: EfficiencyModel,
    plan: BenchSamples,
    *,
    noise: float | None = None,
) -> Isolability:
    """Return which effects a set of operating points can show and distinguish.

    Args:
        model: formulation `power_balance`; supplies the base parameters.
        plan: operating points; the efficiency in it is not used, the presence of output speed,
            pressure and oil temperature is.
        noise: standard deviation of the efficiency [-]; None as in `diagnose`.
    """
    require_model_and_samples(model, plan)
    stages = list(model.stages)
    channels = [channel.name for channel in CHANNELS]
    system = Transmission(model, {*plan.columns, *channels})
    observed = observe(plan, noise, stages)
    base = scaled_base(system.base, model.parameters)
    readings = system.predict(base, (), observed.points)
    further_observed = None
    for channel, row in zip(system.channels, readings, strict=True):
        if getattr(plan, channel.name) is None:
            # The first channel that the bench may read in addition.
            further_plan = replace(plan, **{channel.name: row})
            further_observed = with_meter_errors(
                observe(further_plan, noise, stages), system
            )
            break
    observed = with_meter_errors(observed, system)
    return isolability(system, observed, base, further_observed)


def read_plan(
    path: str | os.PathLike[str], model: EfficiencyModel, channels: Sequence[str] = ()
) -> BenchSamples:
    """Read operating points and fill in the readings that a model predicts there.

    Args:
        path: CSV as for `read_bench`; column `efficiency` may be missing and is not used.
        model: supplies the readings.
        channels: what will be read in addition to the efficiency; a column of that name counts too.

    Raises:
        InputError: as `read_bench` and `stage_of_each`, or the model has no answer at a point.
    """
    known, extra, table = read_columns(path, tuple(axis.name for axis in AXES))
    plan = BenchSamples(
        **{**known, "efficiency": np.ones(len(table.rows))},
        extra=extra,
        source=table.source,
        sha256=table.sha256,
        rows=tuple(table.rows),
    )
    stage_of_each(model.stages, plan)
    expected = model.readings_at(plan.points)
    unanswered = np.flatnonzero(np.isnan(expected["efficiency"]))
    if len(unanswered):
        row = int(unanswered[0])
        raise InputError(
            f"{path}: row {plan.rows[row]}: load_torque = {plan.load_torque[row]:g} "
            f"cannot be carried there; {_largest_load(model, plan, row):.4g} N m can"
        )
    wanted = {"efficiency", *channels, *known}
    readings: dict[str, Any] = {
        name: row for name, row in expected.items() if name in wanted
    }
    return replace(plan, **readings)


def _largest_load(model: EfficiencyModel, plan: BenchSamples, row: int) -> float:
    """Return the largest load torque that the model carries at a point of a plan [N m]."""
    loads = plan.load_torque[row] * np.linspace(0.01, 1.0, 100)
    points = replace(plan.select(np.full(len(loads), row)), load_torque=loads).points
    efficiency = model.readings_at(points)["efficiency"]
    return float(loads[np.isfinite(efficiency)].max(initial=0.0))
