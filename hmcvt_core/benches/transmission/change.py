# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnosis of what has changed in a transmission since it was sound."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...diagnosis import Diagnosis, diagnose_system
from ...diagnosis.observations import Observations
from ...diagnosis.results.outcome import NAMING
from ...diagnosis.wording import listed, plain
from ...errors import InputError
from ...files.bench import BenchSamples
from ...model.model import EfficiencyModel
from ...model.oil import oil_remarks
from ...model.plausibility import gear_train_remarks
from ..baseline import (
    FEWEST_CHANGED,
    ChangeDiagnosis,
    Reference,
    compare,
    control_and_rest,
    extrapolation_notes,
    judge_control,
)
from .channels import CHANNELS, OIL_TEMPERATURE
from .meter_scale import ZERO, zero_scales
from .meters import with_meter_errors
from .misfit import with_misfits
from .readings import observe
from .sound import SoundTransmission, fit_sound_transmission, observe_change
from .system import Transmission

COMPARED = (*(channel.name for channel in CHANNELS[1:]), OIL_TEMPERATURE.name)
"""Columns that count only where all files have them."""
STEERED = ("displacement_ratio", "engine_speed", "load_torque")
"""Columns along which samples may go beyond the baseline."""
FIRST_DATE = 1e8
"""Stamp from which stamps count as dates, 1973 [s]: no bench counts its own seconds for years."""
NOTABLE_SCALE = 1.5
"""Deviation of zeros / that of the class from which a note names a meter; chosen."""


def diagnose_change(
    model: EfficiencyModel,
    samples: BenchSamples,
    baseline: BenchSamples,
    holdout: BenchSamples | None,
    *,
    noise: float | None,
    warnings: Sequence[str],
    seed: int,
    progress: Callable[[str], None] | None,
) -> ChangeDiagnosis:
    """Diagnose what has changed in a transmission since it was sound.

    Args:
        model: formulation `power_balance`; it is refitted to the sound samples.
        samples: of the transmission as it is now.
        baseline: of the same transmission when it was sound, or of a sister; at least sixteen.
        holdout: further samples as it is now, or None.
        noise: standard deviation of the efficiency [-], or None.
        warnings: why the samples may be of another machine.
        seed: of every random number.
        progress: as of `diagnose_system`.

    Raises:
        InputError: the baseline is of another machine or has too few samples, or as
            `diagnose_system`.
    """
    _check_machine(model, samples, baseline)
    notes = shared_test_notes(samples, baseline)
    tables = [samples, baseline]
    if holdout is not None:
        tables.append(holdout)
    tables = _with_common_columns(tables, notes)
    samples, baseline = tables[:2]
    notes += oil_remarks(model, samples)
    left_out, fitted = control_and_rest(baseline, seed)
    if progress is not None:
        progress("the sound transmission")
    sound = _sound(model, baseline, fitted, noise, seed, notes)
    of_control = _answered(sound, baseline.select(left_out), notes)
    control = judge_control(sound, observe_change(sound, of_control, noise), seed)
    sound = replace(sound, inflation=control.inflation)
    notes += extrapolation_notes(sound.samples, samples, STEERED, "transmission")
    held_out = None
    if holdout is not None:
        held_out = observe_change(sound, _answered(sound, tables[2], notes), None)
    samples = _answered(sound, samples, notes)
    observed = observe_change(sound, samples, noise)
    notes += _noise_notes(observed, samples, noise)
    reference = Reference(sound, len(baseline), control, notes=tuple(notes))
    diagnosis, record = compare(
        reference, observed, held_out, seed=seed, progress=progress
    )
    change = record.applied_to(_with_warnings(diagnosis, warnings))
    change = with_misfits(change, sound.model.misfit)
    return ChangeDiagnosis.of(change, record)


def _check_machine(
    model: EfficiencyModel, samples: BenchSamples, baseline: BenchSamples
) -> None:
    """Refuse a baseline whose gear train is another than that of the samples."""
    of_baseline = gear_train_remarks(model, baseline)
    of_samples = gear_train_remarks(model, samples)
    if bool(of_baseline) == bool(of_samples):
        return
    remark = (of_baseline or of_samples)[0]
    raise InputError(
        f"{baseline.source}: the baseline is of another machine than {samples.source}: {remark}"
    )


def shared_test_notes(samples: BenchSamples, baseline: BenchSamples) -> list[str]:
    """Say which tests of samples are in the baseline too, and which days both were measured on.

    Args:
        samples: of the transmission as it is now.
        baseline: of the same transmission when it was sound.

    Raises:
        InputError: all tests are in the baseline too.
    """
    names = [name for name in samples.columns if name in baseline.columns]
    of_baseline = set(_rows(baseline, names))
    shared = []
    for index, row in enumerate(_rows(samples, names)):
        if row in of_baseline:
            shared.append(index)
    if len(shared) == len(samples):
        raise InputError(
            f"{samples.source}: every test is in the baseline {baseline.source} too: give the "
            "tests that were measured later"
        )
    notes = []
    if shared:
        notes.append(
            f"{len(shared)} of {len(samples)} tests of {samples.source} (first: "
            f"{samples.label(shared[0])}) are in the baseline {baseline.source} too, with the "
            "same readings: a test that was measured twice does not repeat all of them, so "
            "check the files"
        )
    days = sorted(_days(samples) & _days(baseline))
    if days:
        notes.append(
            f"{samples.source} and the baseline {baseline.source} hold tests of the same days "
            f"({', '.join(days)}): check that each file is the right one"
        )
    return notes


def _rows(samples: BenchSamples, names: Sequence[str]) -> list[tuple[Any, ...]]:
    """Return the values of each test in some columns."""
    columns = [samples.columns[name].tolist() for name in names]
    return list(zip(*columns, strict=True))


def _days(samples: BenchSamples) -> set[str]:
    """Return the ISO dates of the stamps that count from 1970, none where they do not."""
    if samples.stamp is None:
        return set()
    dated = samples.stamp[samples.stamp > FIRST_DATE]
    days = dated.astype("datetime64[s]").astype("datetime64[D]")
    return set(np.datetime_as_string(days).tolist())


def _noise_notes(
    observed: Observations, samples: BenchSamples, noise: float | None
) -> list[str]:
    """Say that the scatter of the baseline stands for a noise that is stated.

    Args:
        observed: the samples with the noise that the baseline shows.
        samples: may state their noise.
        noise: standard deviation of the efficiency that is stated for all [-], or None.
    """
    if noise is not None:
        stated = noise
        source = "--noise"
    elif samples.efficiency_std is not None:
        stated = float(np.sqrt(np.mean(samples.efficiency_std**2)))
        source = "column efficiency_std"
    else:
        return []
    channel = observed.channels[0]
    return [
        f"the noise is {channel.factor * observed.stated_noise:.2g} {channel.unit}, estimated from "
        f"the scatter of the baseline about its fit, not {channel.factor * stated:.2g} "
        f"{channel.unit} by {source}: a change has to exceed what the sound tests show"
    ]


def _with_common_columns(
    tables: Sequence[BenchSamples], notes: list[str]
) -> list[BenchSamples]:
    """Return the files without the columns that one of them lacks."""
    common = list(tables)
    for name in COMPARED:
        without = [table.source for table in tables if getattr(table, name) is None]
        if not without or len(without) == len(tables):
            continue
        notes.append(
            f"{', '.join(without)} lacks column {name}, so that of the other files is not used"
        )
        without_column: Any = {name: None}
        common = [replace(table, **without_column) for table in common]
    return common


def _sound(
    model: EfficiencyModel,
    baseline: BenchSamples,
    fitted: NDArray[np.intp],
    noise: float | None,
    seed: int,
    notes: list[str],
) -> SoundTransmission:
    """Fit the sound transmission, with the effects that a diagnosis of it names.

    Args:
        model: formulation `power_balance`.
        baseline: sound samples.
        fitted: indices of those that are not the control.
        noise: standard deviation of the efficiency [-], or None.
        seed: of every random number.
        notes: are extended.
    """
    samples = baseline.select(fitted)
    system = Transmission(model, samples.columns)
    # Messages number the samples as the file does.
    numbered = replace(observe(samples, noise, list(model.stages)), number=fitted)
    observed = with_meter_errors(numbered, system)
    of_sound = with_misfits(diagnose_system(system, observed, seed=seed))
    if of_sound.verdict in NAMING:
        effects = " and ".join(plain(name) for name in of_sound.sets[0].effects)
        notes.append(
            f"the baseline itself differs from the model: {effects} "
            f"({100.0 * of_sound.sets[0].probability:.0f} %); it is diagnosed first and held"
        )
    if of_sound.left_out:
        notes.append(
            f"tests of the baseline {baseline.source} that stand alone against their neighbours: "
            f"{listed(of_sound.left_out, 'and')}; measure them again"
        )
    zeros = zero_scales(of_sound.shared_errors)
    notes += _zero_notes(zeros)
    return fit_sound_transmission(of_sound.model, observed, of_sound.parameters, zeros)


def _zero_notes(zeros: Mapping[str, float]) -> list[str]:
    """Return a note on torque meters with zeros beyond their class in the baseline.

    The efficiency is computed from both torques, so that the zero of one meter appears as opposite
    zeros of both. The larger scale then need not be that of the meter that moved.

    Args:
        zeros: scales of the zeros, by `zero_scales`.
    """
    large = [name for name, scale in zeros.items() if scale > NOTABLE_SCALE]
    if not large:
        return []
    meters = " or ".join(name.removeprefix(ZERO) for name in large)
    scale = max(zeros[name] for name in large)
    doubt = ""
    if len(large) > 1:
        doubt = " (the tests barely distinguish the two)"
    return [
        f"the zeros of the {meters} moved by {scale:.1f} times their class between the sessions "
        f"of the baseline{doubt}; the comparison allows for as much"
    ]


def _answered(
    sound: SoundTransmission, samples: BenchSamples, notes: list[str]
) -> BenchSamples:
    """Return the samples whose load the sound transmission carries; the others are named.

    Raises:
        InputError: too few remain.
    """
    observed = observe(samples, None, list(sound.model.stages))
    answered = sound.answers(observed.points)
    if answered.all():
        return samples
    first = observed.describe(int(np.flatnonzero(~answered)[0]))
    lost = (
        f"{samples.source}: {int(np.sum(~answered))} of {len(samples)} samples "
        f"{sound.refusal} with the sound transmission (first: {first})"
    )
    if answered.sum() < FEWEST_CHANGED:
        raise InputError(f"{lost}; at least {FEWEST_CHANGED} have to remain")
    notes.append(f"{lost}; they were left out")
    return samples.select(np.flatnonzero(answered))


def _with_warnings(diagnosis: Diagnosis, warnings: Sequence[str]) -> Diagnosis:
    """Return a diagnosis with warnings before its notes."""
    return replace(
        diagnosis,
        warnings=(*warnings, *diagnosis.warnings),
        notes=(*warnings, *diagnosis.notes),
    )
