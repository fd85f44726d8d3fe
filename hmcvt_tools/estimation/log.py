# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The estimate over a whole log, in bounded memory."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.files import picture, preformatted
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.files.table import csv_text
from hmcvt_core.model.engine import Engine
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.model.oil import without_oil_temperature
from hmcvt_core.transmission.quantities import real_numbers
from hmcvt_core.transmission.ranges import Array

from ..logs.opening import open_log
from ..logs.selection import Selection, Stated, read_rows, select
from ..logs.series import Log, Report
from .condition import (
    follows_viscosity,
    identified_temperatures,
    outside_identified,
)
from .rows import Estimator, Rows, SeriesFile
from .settings import EstimateSettings
from .solving import Stages
from .totals import Totals

_DIESEL = 0.832
"""Density of diesel [kg/L], middle of EN 590 at 15 deg C."""
_LONGEST_ROW = 3.0
"""Usual steps that a row stands for at most; what is longer is a gap."""
_BEYOND = (
    "within what a bus can tell: torque bias and rounding, delays, parameters and form of "
    "the model; not a power take-off or hydraulics that the bus does not state"
)


@dataclass(frozen=True, eq=False)
class Estimate:
    """What a machine did, by its log.

    Attributes:
        totals: energies, fuel, hours by stage and the map of operating points.
        source: name of the log.
        notes: what could not be used, and what was taken for granted.
    """

    totals: Totals
    source: str = ""
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object of `hmcvt estimate --json`."""
        totals = self.totals
        low, high = totals.output_interval
        return {
            "seconds": totals.seconds,
            "energy": {
                "engine": totals.engine,
                "output": totals.output,
                "lost": totals.lost,
            },
            "fuel": totals.fuel,
            "stages": dict(sorted(totals.stages.items())),
            "coverage": totals.coverage,
            "output_interval": [low, high],
            "fuel_lost": totals.fuel_lost,
            "without": dict(totals.without),
            "map": totals.map_rows(),
            "notes": list(self.notes),
        }

    def report(self) -> str:
        """Return the totals as text."""
        totals = self.totals
        low, high = totals.output_interval
        lines = [
            f"{self.source}: {totals.seconds / 3600.0:.2f} h with the engine on, "
            f"{100.0 * totals.coverage:.1f} % of it estimated",
            f"engine to transmission  {totals.engine / 3.6e6:.2f} kWh",
            f"output                  {totals.output / 3.6e6:.2f} kWh (90 %: "
            f"{low / 3.6e6:.2f} to {high / 3.6e6:.2f})",
            f"lost in transmission    {totals.lost / 3.6e6:.2f} kWh",
        ]
        if totals.fuel > 0.0:
            lines.append(
                f"fuel                    {totals.fuel:.2f} kg, {totals.fuel_lost:.2f} kg "
                f"({totals.fuel_lost / _DIESEL:.2f} L) of it for what the transmission lost"
            )
        for stage, seconds in sorted(totals.stages.items()):
            lines.append(f"  {stage:<12} {seconds / 3600.0:8.3f} h")
        for reason, seconds in sorted(totals.without.items()):
            lines.append(f"  no estimate for {seconds:.1f} s: {reason}")
        lines += [f"  note: {note}" for note in self.notes]
        lines.append(f"intervals are {_BEYOND}")
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.report()

    def write_map(self, path: str | os.PathLike[str]) -> None:
        """Write the map of operating points as CSV, one row for each cell.

        Raises:
            InputError: no row of the log has an operating point.
        """
        rows = self.totals.map_rows()
        if not rows:
            raise InputError(f"{self.source}: no operating point to write")
        columns = {name: [row[name] for row in rows] for name in rows[0]}
        write_atomically(Path(path), csv_text(columns))

    def plot(self, ax: Any = None) -> Any:
        """Draw where the machine works: hours over engine speed and load torque.

        Args:
            ax: matplotlib axes to draw on; a new figure when left out.

        Returns:
            The matplotlib figure.
        """
        return picture(self, ax=ax)

    def _repr_html_(self) -> str:
        return preformatted(self.report())


def estimate(
    log: str | os.PathLike[str] | Log,
    model: EfficiencyModel,
    engine: Engine | None = None,
    *,
    dbc: str | os.PathLike[str] | None = None,
    channels: Mapping[str, str] | None = None,
    reference_torque: float | None = None,
    friction_torque: float | None = None,
    stage_names: Mapping[str, str] | None = None,
    group: str = "",
    out: str | os.PathLike[str] | None = None,
    settings: EstimateSettings | None = None,
    progress: Report | None = None,
    on_rows: Callable[[Rows], None] | None = None,
) -> Estimate:
    """Estimate output torque and power, losses and efficiency over a log.

    Args:
        log: path of an MDF4 or TDMS file or a CAN trace, or an open log.
        model: of the transmission; of several stages, the one engaged follows from the log.
        engine: fuel map; needed where the bus states a fuel rate and no torque, and for the fuel
            where it states none.
        dbc: signals of a maker's CAN messages.
        channels: `CHANNEL` or `CHANNEL:UNIT` by quantity, such as
            `{"output_speed": "n_out:rpm"}`; those left out are proposed.
        reference_torque: engine torque of 100 % [N m], where the bus does not state it.
        friction_torque: friction of the engine as a part of it [-], where the bus does not
            state it.
        stage_names: stage by what stands in its channel; the text itself when left out.
        group: group, run or bus that is read where several hold the same channels.
        out: CSV file for the rows, `stamp` to `efficiency`.
        settings: errors of the bus.
        progress: called with how much of the log is read.
        on_rows: called with the rows of each piece.

    Returns:
        Energies, fuel, hours by stage, and the map of operating points.

    Raises:
        InputError: the log cannot be read, or its channels do not suffice.
    """
    friction = None
    if friction_torque is not None:
        friction = 100.0 * float(real_numbers(friction_torque, "friction_torque"))
    with ExitStack() as stack:
        opened = log
        if not isinstance(opened, Log):
            opened = stack.enter_context(open_log(opened, dbc))
        stated = Stated(
            channels or {},
            reference_torque,
            friction,
            stage_names or {},
            group,
        )
        selection = select(opened, stated)
        _require_quantities(opened, selection, engine)
        file = None
        if out is not None:
            file = stack.enter_context(SeriesFile(Path(out)))
        settings = settings or EstimateSettings()
        run = _Run(opened, selection, model, engine, settings)
        for rows in run.pieces():
            if file is not None:
                file.write(rows)
            if on_rows is not None:
                on_rows(rows)
            if progress is not None:
                progress(f"{100.0 * opened.progress_of():.0f} %")
        notes = (
            *_notes(selection),
            *_condition_notes(selection, model, settings, run.seconds_outside),
            *opened.remarks.lines,
        )
        return Estimate(run.totals, str(opened.path), notes)


def _require_quantities(log: Log, selection: Selection, engine: Engine | None) -> None:
    """Raise an `InputError` where the channels do not suffice, or leave something open."""
    known = selection.quantities
    hints = [*map(str, selection.proposal.questions), *selection.proposal.notes]
    missing = []
    if "output_speed" not in known:
        missing.append("output_speed")
    if not {"engine_torque", "engine_power", "fuel_rate"} & known:
        missing.append("engine_torque (or fuel_rate)")
    if missing:
        text = f"{log.path}: no channel is named for {', '.join(missing)}"
        raise InputError("; ".join([text, *hints]))
    if not {"engine_torque", "engine_power"} & known and engine is None:
        raise InputError(
            f"{log.path}: without engine torque, the fuel rate needs --engine"
        )
    used = {column.name.rpartition(".")[2] for column in selection.columns.values()}
    for question in selection.proposal.questions:
        if any(f"{name!r}" in question.text for name in used):
            raise InputError(f"{log.path}: {question}")


def _notes(selection: Selection) -> list[str]:
    known = selection.quantities
    notes = []
    if selection.torque is not None and selection.torque.friction is not None:
        notes.append(
            f"friction of the engine: {selection.torque.friction:g} %, as stated"
        )
    if not {"engine_torque", "engine_power"} & known:
        notes.append("the engine torque follows from the fuel rate")
    if not {"displacement_ratio", "stage"} & known:
        notes.append("the stage follows from the speed ratio alone")
    return notes


def _condition_notes(
    selection: Selection,
    model: EfficiencyModel,
    settings: EstimateSettings,
    seconds_outside: float,
) -> list[str]:
    """Return what is known and unknown of oil, wear and working hydraulics."""
    notes = []
    temperatures = identified_temperatures(model, settings)
    if "oil_temperature" not in selection.quantities:
        notes.append(
            "the log states no oil temperature: cold or hot oil is not in the intervals"
        )
    elif follows_viscosity(model):
        notes.append(
            "leakage and dampings follow the oil temperature of the log by the effect of the model"
        )
    elif temperatures is None:
        notes.append(
            "cold or hot oil is not in the intervals, and leakage and dampings do not follow the "
            "oil temperature of the log: the model does not state the one of its identification "
            "(--identified-temperature says it)"
        )
    elif not model.states_errors:
        notes.append(
            "cold or hot oil is not in the intervals, and leakage and dampings do not follow the "
            "oil temperature of the log: the model states no errors of its parameters"
        )
    else:
        notes.append(
            f"leakage and dampings follow the oil temperature of the log; {seconds_outside:.0f} s "
            f"are outside the {temperatures[0]:.0f} to {temperatures[1]:.0f} deg C of the "
            "identification"
        )
    notes += _oil_notes(model, "oil_temperature" in selection.quantities)
    if settings.wear == 0.0:
        notes.append("wear since the identification is not in the intervals (--wear)")
    elif not model.states_errors:
        notes.append(
            "wear is not in the intervals: the model states no errors of its parameters"
        )
    else:
        notes.append(
            f"by wear the leakage is taken as up to {100.0 * settings.wear:.0f} % above the "
            f"identified one, {50.0 * settings.wear:.0f} % in the middle (--wear 0: as identified)"
        )
    if settings.hydraulics_high == 0.0:
        notes.append("working hydraulics are not in the intervals (--hydraulics)")
    return notes


def _oil_notes(model: EfficiencyModel, has_temperature: bool) -> list[str]:
    """Return which effects follow the oil, where the model has such effects.

    Args:
        model: with its effects.
        has_temperature: whether the log states the oil temperature.
    """
    followers = [effect for effect in model.effects if effect.needs_oil_temperature]
    if not has_temperature:
        return without_oil_temperature(followers)
    names = dict.fromkeys(effect.name for effect in followers)
    return [f"effect {name} follows the oil temperature of the log" for name in names]


@dataclass
class _Run:
    """The estimate of one log, piece by piece.

    Attributes:
        log, selection, model, engine, settings: what is estimated, and by what.
        totals: sums so far.
        seconds_outside: with the oil outside the temperatures of the identification.
    """

    log: Log
    selection: Selection
    model: EfficiencyModel
    engine: Engine | None
    settings: EstimateSettings
    totals: Totals = field(default_factory=Totals)
    seconds_outside: float = 0.0
    _last: float = field(default=float("nan"), init=False)

    def pieces(self) -> Iterator[Rows]:
        """Yield the rows of each piece, added to the totals."""
        estimator = Estimator(
            self.model.without_meters(),
            Stages.of(self.model),
            self.engine,
            self.selection,
            self.settings,
            str(self.log.path),
        )
        for joined, values in read_rows(self.log, self.selection, self.settings.step):
            rows = estimator.rows(joined, values)
            fuel = self._fuel(rows, values)
            self._add(rows, fuel, values, list(estimator.stages.names))
            yield rows

    def _fuel(self, rows: Rows, values: dict[str, Any]) -> Array:
        """Return the fuel rate [kg/s], NaN where it is not known."""
        if "fuel_rate" in values:
            return np.asarray(values["fuel_rate"])
        if self.engine is None:
            return np.full(len(rows.time), np.nan)
        speed = rows.engine_speed
        with np.errstate(invalid="ignore", divide="ignore"):
            torque = np.maximum(rows.engine_power / speed, 0.0)
        return np.asarray(self.engine.fuel_rate(speed, torque))

    def _durations(self, time: Array) -> Array:
        """Return the seconds that each row stands for."""
        steps = np.diff(time, prepend=self._last)
        self._last = float(time[-1])
        known = steps[np.isfinite(steps)]
        usual = float(np.median(known)) if len(known) else self.settings.step
        usual = max(usual, 1e-6)
        return np.where(steps <= _LONGEST_ROW * usual, steps, usual)

    def _add(
        self, rows: Rows, fuel: Array, values: dict[str, Any], names: list[str]
    ) -> None:
        totals = self.totals
        seconds = self._durations(rows.time)
        temperatures = identified_temperatures(self.model, self.settings)
        if "oil_temperature" in values and temperatures is not None:
            outside = outside_identified(values["oil_temperature"], temperatures)
            self.seconds_outside += float(seconds[outside].sum())
        runs = np.isfinite(rows.engine_speed) & (rows.reason != "the engine stands")
        answered = rows.reason == ""
        totals.seconds += float(seconds[runs].sum())
        totals.estimated += float(seconds[answered].sum())
        for reason in np.unique(rows.reason[runs & ~answered]).tolist():
            of_reason = runs & (rows.reason == reason)
            totals.without[reason] += float(seconds[of_reason].sum())
        weight = np.where(answered, seconds, 0.0)
        totals.engine += float(np.nansum(weight * rows.engine_power))
        totals.output += float(np.nansum(weight * rows.output_power))
        totals.lost += float(np.nansum(weight * rows.power_loss))
        totals.add_deviations(np.nansum(weight * rows.deviations.lasting, axis=1))
        passing = weight * rows.deviations.passing
        totals.passing_variance += float(np.nansum(passing**2))
        totals.fuel += float(np.nansum(seconds * fuel))
        with np.errstate(invalid="ignore", divide="ignore"):
            part = np.clip(rows.power_loss / rows.engine_power, 0.0, 1.0)
        part = np.where(rows.engine_power > 0.0, part, 0.0)
        totals.fuel_lost += float(np.nansum(weight * fuel * part))
        for name in np.unique(rows.stage[answered]).tolist():
            of_stage = answered & (rows.stage == name)
            totals.stages[name] += float(seconds[of_stage].sum())
        self._add_to_map(rows, weight, names)

    def _add_to_map(self, rows: Rows, weight: Array, names: list[str]) -> None:
        (at,) = np.nonzero((weight > 0.0) & np.isfinite(rows.load_torque))
        if not len(at):
            return
        numbers = {name: number for number, name in enumerate(names)}
        stages, index = np.unique(rows.stage[at], return_inverse=True)
        codes = np.array([numbers[str(name)] for name in stages])[index]
        sums = np.stack(
            [
                weight[at],
                weight[at] * rows.output_power[at],
                weight[at] * rows.power_loss[at],
            ]
        )
        self.totals.add_cells(
            codes,
            (
                rows.displacement_ratio[at],
                rows.engine_speed[at],
                rows.load_torque[at],
            ),
            sums,
            dict(enumerate(names)),
        )
