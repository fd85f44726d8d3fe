# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Error and coverage of an estimate against what truly happened."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core import EfficiencyModel, data_path, load_model
from hmcvt_tools.estimation import EstimateSettings, estimate
from hmcvt_tools.estimation.rows import Rows

from .bus import EPOCH, Faults, encode, write_trace
from .drive import Array, Drive, Machine

MIN_POWER = 3e3
"""Output power from which a relative error is counted [W]."""
_SLOW_SPEED = 0.02
"""Change of the engine speed within a second that is slow, a fraction."""
_SLOW_POWER = 0.1
"""The same of the output power."""


class Score(NamedTuple):
    """Errors over the rows of one log.

    Attributes:
        slow: errors of the output power, relative, in steady and slow parts.
        slow_inside: whether the interval holds the true power there.
        inside: whether it does anywhere.
        torque_inside: the same of the output torque, in steady and slow parts.
        stage_right: whether the stage is the true one, anywhere.
        energy: relative error of the output energy.
        energy_inside: whether its interval holds the true energy.
        coverage: part of the time with an estimate.
    """

    slow: Array
    slow_inside: NDArray[np.bool_]
    inside: NDArray[np.bool_]
    torque_inside: NDArray[np.bool_]
    stage_right: NDArray[np.bool_]
    energy: float
    energy_inside: bool
    coverage: float


def well_known() -> EfficiencyModel:
    """The five stages with the standard errors of some 60 tests: a third of those of eight."""
    model = load_model(data_path("params/tractor.yaml"))
    fitted = load_model(data_path("params/hm4.yaml"))
    errors = {name: error / 3.0 for name, error in fitted.standard_errors.items()}
    return replace(model, standard_errors=errors, correlation=fitted.correlation)


def scored(
    folder: Path,
    model: EfficiencyModel,
    machine: Machine,
    driven: Drive,
    faults: Faults,
    with_unit: bool,
    settings: EstimateSettings | None = None,
) -> Score:
    """Write the trace of a drive, estimate it and compare.

    Args:
        folder: for the trace.
        model: that the estimate takes.
        machine: the true tractor.
        driven: what it truly did.
        faults: errors of its bus.
        with_unit: whether the bus carries displacement ratio and stage.
        settings: what the estimate knows of the errors.
    """
    from .bus import MAKER

    trace = folder / "drive.log"
    write_trace(trace, encode(driven, machine, faults, with_unit))
    dbc = None
    if with_unit:
        dbc = folder / "maker.dbc"
        dbc.write_text(MAKER)
    parts: list[Rows] = []
    result = estimate(trace, model, dbc=dbc, settings=settings, on_rows=parts.append)
    totals = result.totals
    time = np.concatenate([rows.time for rows in parts]) - EPOCH
    power = np.concatenate([rows.output_power for rows in parts])
    low = np.concatenate([rows.output_power_interval[0] for rows in parts])
    high = np.concatenate([rows.output_power_interval[1] for rows in parts])
    torque_low = np.concatenate([rows.output_torque_interval[0] for rows in parts])
    torque_high = np.concatenate([rows.output_torque_interval[1] for rows in parts])
    stage = np.concatenate([rows.stage for rows in parts])
    rows_of = np.clip(np.searchsorted(driven.time, time), 0, len(driven.time) - 1)
    # Where the machine cannot carry the load, nothing is true.
    carried = np.isfinite(driven.engine_torque)[rows_of]
    true = np.where(carried, driven.output_power[rows_of], np.nan)
    counted = np.isfinite(power) & (true > MIN_POWER)
    slow = counted & _slow(driven)[rows_of]
    with np.errstate(divide="ignore", invalid="ignore"):
        true_torque = true / driven.output_speed[rows_of]
    inside = (low <= true) & (true <= high)
    torque_inside = (torque_low <= true_torque) & (true_torque <= torque_high)
    answered = np.isfinite(power) & carried
    steps = np.median(np.diff(time))
    true_energy = float(true[answered].sum() * steps)
    energy_low, energy_high = totals.output_interval
    return Score(
        np.abs(power[slow] / true[slow] - 1.0),
        inside[slow],
        inside[counted],
        torque_inside[slow],
        stage[counted] == driven.stage[rows_of][counted],
        totals.output / true_energy - 1.0 if true_energy else np.nan,
        energy_low <= true_energy <= energy_high,
        totals.coverage,
    )


def _slow(driven: Drive) -> NDArray[np.bool_]:
    """Where engine speed and output power change slowly, shape (n,)."""
    speed_change = np.abs(np.gradient(driven.engine_speed, driven.time))
    power_change = np.abs(np.gradient(driven.output_power, driven.time))
    slow = speed_change < _SLOW_SPEED * driven.engine_speed
    return np.asarray(slow & (power_change < _SLOW_POWER * driven.output_power))
