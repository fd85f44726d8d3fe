# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bench samples as observations of the diagnosis: channels, noise, copies and held-out samples."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ...diagnosis.observations import (
    Observations,
    assumed_prior_dof,
    noise_statement,
)
from ...diagnosis.system import Array, Axis, Channel, Points
from ...errors import InputError
from ...files.bench import BenchSamples
from ...model.staged_samples import stage_of_each
from ...transmission import ranges
from .channels import AXES, CHANNELS, EFFICIENCY_CHANNEL, OIL_TEMPERATURE, STAGE

MIN_DEVIATION = 1e-5
"""Smallest standard deviation of an efficiency that is believed [-]: meters resolve no less."""
ASSUMED_NOISE = "assumed, 1.12 % (paper, eq. (3))"
"""Source of a noise that nothing states."""


def observe(
    samples: BenchSamples, noise: float | None = None, stages: Sequence[str] = ()
) -> Observations:
    """Set up the channels that bench samples hold.

    Args:
        samples: bench samples.
        noise: standard deviation of the efficiency [-]; None takes `efficiency_std`, else repeated
            points, else the paper's 1.12 %.
        stages: names of the model's stages, where it has several; each sample then names its
            stage.

    Raises:
        InputError: `noise` is out of range, or as `stage_of_each`.
    """
    if noise is not None:
        noise = float(ranges.EFFICIENCY_STD.check(noise, "noise"))
    axes, points = _operating_points(samples, stages)
    stated = samples.efficiency_std
    if stated is not None:
        stated = np.maximum(stated, MIN_DEVIATION)
    efficiency_deviation, efficiency_dof, source = noise_statement(
        EFFICIENCY_CHANNEL, samples.efficiency, noise, stated, axes, points
    )
    channels: list[Channel] = []
    measured: list[Array] = []
    deviation: list[Array] = []
    prior_dof: list[float] = []
    for channel in CHANNELS:
        readings = getattr(samples, channel.name)
        if readings is None:
            continue
        channels.append(channel)
        measured.append(readings)
        if channel is EFFICIENCY_CHANNEL:
            deviation.append(efficiency_deviation)
            prior_dof.append(efficiency_dof)
        else:
            deviation.append(channel.deviation(readings))
            prior_dof.append(assumed_prior_dof(len(samples)))
    return Observations(
        axes=axes,
        points=points,
        channels=tuple(channels),
        measured=np.stack(measured),
        deviation=np.stack(deviation),
        prior_dof=np.array(prior_dof),
        samples=samples,
        number=np.arange(len(samples)),
        noise_source=source or ASSUMED_NOISE,
        assumed=source is None,
    )


def _operating_points(
    samples: BenchSamples, stages: Sequence[str]
) -> tuple[tuple[Axis, ...], Points]:
    """Axes that the samples vary or record, and the values along each."""
    axes: tuple[Axis, ...] = AXES
    if samples.oil_temperature is not None:
        axes = (*axes, OIL_TEMPERATURE)
    points = {axis.name: getattr(samples, axis.name) for axis in axes}
    if len(stages) < 2:
        return axes, points
    names = stage_of_each(stages, samples)
    if names is not None:
        axes = (*axes, replace(STAGE, labels=tuple(stages)))
        points[STAGE.name] = np.array([stages.index(name) for name in names], float)
    return axes, points


def distinct_observations(
    samples: BenchSamples, noise: float | None, stages: Sequence[str]
) -> tuple[Observations, list[str]]:
    """Observe samples without rows that copy another one.

    A copy does not show the noise, unlike readings repeated at one point.

    Args:
        samples: bench samples.
        noise: as of `observe`.
        stages: as of `observe`.

    Returns:
        The observations, and notes on what was left out.
    """
    columns = [column.name for column in ranges.BENCH_COLUMNS]
    rows = zip(_rows(samples, columns), *samples.extra.values(), strict=True)
    seen: set[object] = set()
    kept = []
    for i, row in enumerate(rows):
        if row not in seen:
            seen.add(row)
            kept.append(i)
    notes = []
    if len(kept) < len(samples):
        notes.append(
            f"{len(samples) - len(kept)} of {len(samples)} rows copy another one in every "
            "column and were left out"
        )
    observed = observe(samples.select(kept), noise, stages)
    return replace(observed, number=np.array(kept)), notes


def held_out_observations(
    holdout: BenchSamples, samples: BenchSamples, stages: Sequence[str]
) -> tuple[Observations, list[str]]:
    """Observe held-out samples without those that are diagnosed too.

    Args:
        holdout: held-out samples, with their own noise if they state any.
        samples: the samples that are diagnosed.
        stages: as of `observe`.

    Returns:
        The observations, and notes on what was left out.

    Raises:
        InputError: the holdout lacks a column that the samples have, or holds nothing new.
    """
    if holdout.oil_temperature is None and samples.oil_temperature is not None:
        raise InputError(
            f"{holdout.source}: column oil_temperature is missing; {samples.source} "
            "has it"
        )
    diagnosed = set(_rows(samples, ranges.REQUIRED_COLUMNS))
    rows = _rows(holdout, ranges.REQUIRED_COLUMNS)
    kept = [i for i, row in enumerate(rows) if row not in diagnosed]
    if not kept:
        raise InputError(
            f"{holdout.source}: every held-out sample is among those diagnosed; hold "
            "out samples that were measured separately, or leave the holdout out for "
            "cross-validation"
        )
    notes = []
    if len(kept) < len(holdout):
        notes.append(
            f"{len(holdout) - len(kept)} of {len(holdout)} held-out samples are among "
            "those diagnosed and were left out"
        )
    observed = observe(holdout.select(kept), stages=stages)
    return replace(observed, number=np.array(kept)), notes


def _rows(samples: BenchSamples, names: Iterable[str]) -> list[tuple[object, ...]]:
    """Return the values of each sample in those of the columns that it has."""
    columns = [getattr(samples, name) for name in names]
    present = [column.tolist() for column in columns if column is not None]
    return list(zip(*present, strict=True))
