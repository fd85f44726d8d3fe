# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnosis of what has changed in a pump or motor since it was sound."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...diagnosis import Diagnosis
from ...errors import InputError
from ...files import preformatted
from ..baseline import (
    FEWEST_CHANGED,
    Baseline,
    Reference,
    compare,
    control_and_rest,
    extrapolation_notes,
    judge_control,
)
from ..transmission.channels import OIL_TEMPERATURE
from .samples import MIN_TORQUE_PRESSURE, UnitSamples
from .sound import (
    ChangedUnit,
    SoundUnit,
    fit_sound_unit,
    observe_change,
    varied_axes,
    with_oil_temperature,
)
from .system import CHANNEL_UNITS

SAME_DISPLACEMENT = 0.02
"""Fraction by which the displacements of both files may differ.

The displacement of a unit is known to about one percent (ISO 8426); sizes of makers differ by more.
"""
LARGEST_SOUND_LOSS = 0.25
"""Most flow that a sound unit loses, as a part of the ideal flow, at the upper half of its speeds.

Makers state volumetric efficiencies of 0.85 to 0.98 at rated pressure.
"""


@dataclass(frozen=True, eq=False)
class UnitChange:
    """What has changed in a unit since it was sound.

    Attributes:
        diagnosis: as of any system, of the change; the gap is that of the first channel read in
            both campaigns.
        sound: the unit before.
        model: the unit with the changes that the verdict names.
        baseline: where the sound unit comes from, and its control.
        holdout: held-out samples of the changed unit, or None.
        seed: of every random number.
    """

    diagnosis: Diagnosis
    sound: SoundUnit
    model: ChangedUnit
    baseline: Baseline
    holdout: UnitSamples | None
    seed: int = 0

    @property
    def component(self) -> str | None:
        """The part that has changed, where one holds most of the probability."""
        return self.baseline.component(self.diagnosis)

    @property
    def rmse(self) -> dict[str, dict[str, float | None]]:
        """Errors by channel in SI units: of the sound unit (`base`) and with the changes."""
        models = {"base": ChangedUnit(self.sound, ()), "with_effects": self.model}
        errors: dict[str, dict[str, float | None]] = {}
        for channel in self.sound.channels:
            errors[_short(channel.name)] = {}
        for prefix, samples in (
            ("", self.diagnosis.samples),
            ("holdout_", self.holdout),
        ):
            for name, model in models.items():
                of_model = {} if samples is None else model.rmse(samples)
                for channel in self.sound.channels:
                    row = errors[_short(channel.name)]
                    row[prefix + name] = of_model.get(channel.name)
        return errors

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object of `hmcvt unit --baseline --json`."""
        return {
            **self.diagnosis.to_dict(),
            "component": self.component,
            "baseline": self.baseline.to_dict(self.diagnosis),
            "rmse": self.rmse,
        }

    def report(self) -> str:
        """Return the outcome as text for a person."""
        lines = [self.diagnosis.report(), self.baseline.line()]
        for channel in self.sound.channels:
            row = self.rmse[_short(channel.name)]
            unit, factor = CHANNEL_UNITS[channel.name]
            before = factor * (row["base"] or 0.0)
            after = factor * (row["with_effects"] or 0.0)
            text = f"rms against the sound unit {before:.3g} -> with the change {after:.3g} {unit}"
            if row["holdout_base"] is not None:
                held_before = factor * row["holdout_base"]
                held_after = factor * (row["holdout_with_effects"] or 0.0)
                text += f", held out {held_before:.3g} -> {held_after:.3g}"
            lines.append(f"{_short(channel.name):10} {text}")
        return "\n".join(lines)

    def plot(self, ax: Any = None) -> Any:
        """Return a matplotlib picture of the residuals; see `Diagnosis.plot`."""
        return self.diagnosis.plot(ax)

    def _repr_html_(self) -> str:
        return preformatted(self.report())


def _short(channel: str) -> str:
    return channel.removesuffix("_loss")


def diagnose_change(
    samples: UnitSamples,
    baseline: UnitSamples,
    holdout: UnitSamples | None = None,
    *,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> UnitChange:
    """Diagnose what has changed in a unit since it was sound.

    The sound unit is fitted first and held, with its uncertainty; a part of its samples is left out
    as a control. What an oil temperature beyond those of the baseline explains is attributed to it
    before any wear is.

    Args:
        samples: of the unit as it is now, at least five.
        baseline: of the same unit when it was sound, or of a sister; at least sixteen.
        holdout: further samples of the unit as it is now, to measure the shrinkage on.
        seed: of every random number.
        progress: as of `diagnose_system`.

    Raises:
        InputError: the baseline is of another unit, has too few samples, or shares no reading with
            the samples; or as `diagnose_system`.
    """
    tables = [samples, baseline]
    if holdout is not None:
        tables.append(holdout)
    for table in tables:
        _check_unit(table, baseline)
    channels = _common_channels(tables)
    notes: list[str] = []
    tables = _with_common_temperature(tables, notes)
    if "torque_loss" in channels:
        tables = [
            table.select(table.pressure >= MIN_TORQUE_PRESSURE) for table in tables
        ]
    samples, baseline, *held_out_samples = tables
    holdout = held_out_samples[0] if held_out_samples else None
    _check_count(samples)
    _check_sound(baseline)
    if progress is not None:
        progress("the sound unit")
    left_out, fitted = control_and_rest(baseline, seed)
    sound = fit_sound_unit(baseline.select(fitted), channels, varied_axes(samples))
    of_control = observe_change(sound, baseline.select(left_out))
    control = judge_control(sound, of_control, seed)
    sound = replace(sound, inflation=control.inflation)
    sound = _with_temperature(sound, samples, seed, notes)
    notes += extrapolation_notes(sound.samples, samples, ("pressure", "speed"), "unit")
    held_out = None
    if holdout is not None:
        held_out = observe_change(sound, holdout)
    reference = Reference(sound, len(baseline), control, sound.untestable, tuple(notes))
    diagnosis, record = compare(
        reference,
        observe_change(sound, samples),
        held_out,
        seed=seed,
        progress=progress,
    )
    model = ChangedUnit(sound, ())
    of_mechanisms = record.applied_to(diagnosis)
    if of_mechanisms.named is not None:
        model = of_mechanisms.named.model
    return UnitChange(of_mechanisms, sound, model, record, holdout, seed)


# --- what can be compared -------------------------------------------------------------------


def _check_unit(samples: UnitSamples, baseline: UnitSamples) -> None:
    """Refuse a baseline of another machine, or of one that is not sound."""
    if samples.kind != baseline.kind:
        raise InputError(
            f"{baseline.source}: the baseline is a {baseline.kind}, {samples.source} a "
            f"{samples.kind}"
        )
    ratio = samples.displacement / baseline.displacement
    if abs(np.log(ratio)) > SAME_DISPLACEMENT:
        raise InputError(
            f"{baseline.source}: the baseline has a displacement of "
            f"{_in_cm3(baseline):.4g} cm3, {samples.source} has {_in_cm3(samples):.4g} cm3: "
            "it is another machine"
        )


def _check_count(samples: UnitSamples) -> None:
    """Refuse samples that are too few to show a change."""
    if len(samples) < FEWEST_CHANGED:
        raise InputError(
            f"{samples.source}: {len(samples)} samples are too few to show a change; at least "
            f"{FEWEST_CHANGED} are needed"
        )


def _in_cm3(samples: UnitSamples) -> float:
    """Return the displacement per revolution [cm3]."""
    return 2e6 * np.pi * samples.displacement


def _check_sound(baseline: UnitSamples) -> None:
    """Refuse a baseline that loses more flow than any sound unit."""
    if baseline.flow_loss is None:
        return
    fast = baseline.speed >= np.median(baseline.speed)
    ideal_flow, _ = baseline.ideal
    lost = float(np.median((baseline.flow_loss / ideal_flow)[fast]))
    if lost > LARGEST_SOUND_LOSS:
        raise InputError(
            f"{baseline.source}: the baseline loses {100.0 * lost:.0f} % of its flow, more than a "
            "sound unit: diagnose it by itself first (hmcvt unit), or check its displacement"
        )


def _common_channels(tables: Sequence[UnitSamples]) -> list[str]:
    """Return the readings that all files have."""
    common = [
        name
        for name in tables[0].channels
        if all(name in table.channels for table in tables)
    ]
    if not common:
        read = "; ".join(
            f"{table.source} has {', '.join(table.channels)}" for table in tables
        )
        raise InputError(f"the files share no reading that can be compared: {read}")
    return common


def _with_common_temperature(
    tables: Sequence[UnitSamples], notes: list[str]
) -> list[UnitSamples]:
    """Return the files without an oil temperature where one of them lacks it."""
    without = [table.source for table in tables if table.oil_temperature is None]
    if not without:
        return list(tables)
    if len(without) < len(tables):
        notes.append(
            f"{', '.join(without)} lacks column oil_temperature, so that of the other file is "
            "not used"
        )
    return [replace(table, oil_temperature=None) for table in tables]


# --- oil that is warmer than that of the baseline -------------------------------------------


def _with_temperature(
    sound: SoundUnit, samples: UnitSamples, seed: int, notes: list[str]
) -> SoundUnit:
    """Return the reference for the oil temperatures of the samples.

    Args:
        sound: which is known at the oil temperatures of the baseline.
        samples: of the changed unit.
        seed: of every random number.
        notes: are extended.

    Returns:
        The sound unit; where the oil temperature alone explains the change, with that as the
        only candidate.
    """
    known = sound.samples.oil_temperature
    temperature = samples.oil_temperature
    if known is None or temperature is None:
        return sound
    low = float(known.min()) - OIL_TEMPERATURE.tolerance
    high = float(known.max()) + OIL_TEMPERATURE.tolerance
    outside = (temperature < low) | (temperature > high)
    if not outside.any():
        return sound
    if not _differs(sound, samples, seed):
        return sound
    notes.append(
        f"{int(outside.sum())} of {len(samples)} samples lie outside the oil temperatures of the "
        f"baseline, {known.min():.0f} to {known.max():.0f} deg C"
    )
    extrapolated = replace(sound, extrapolates=True)
    if _differs(extrapolated, samples, seed):
        notes.append(
            "the oil temperature alone does not explain the change; what it explains is taken off"
        )
        return extrapolated
    return with_oil_temperature(sound)


def _differs(sound: SoundUnit, samples: UnitSamples, seed: int) -> bool:
    observed = observe_change(sound, samples)
    return judge_control(sound, observed, seed).alarms
