# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The outcome of a diagnosis as values; nothing is computed here."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...errors import InputError
from ..design.next_test import Advice, NextTest
from ..observations import Observations
from ..selection.posterior import Posterior
from ..settings import GAP_SIGNIFICANCE as GAP_SIGNIFICANCE
from ..settings import REGION_SIGNIFICANCE as REGION_SIGNIFICANCE
from ..system import Array, Axis, Channel

NAMING = ("cause_found", "ambiguous")
"""Verdicts that name a cause."""


@dataclass(frozen=True)
class Gap:
    """Size and significance of the gap after the base parameters are refitted.

    Sizes are in the unit of the first channel, the efficiency of a transmission.

    Attributes:
        samples: how many.
        rmse: of the refitted base model at samples left out.
        noise: standard deviation, as the diagnosis found it.
        noise_stated: as given or assumed; `noise_source` says by whom.
        p_value: that no gap gives as much anywhere.
        significant: whether it counts as a gap.
    """

    samples: int
    rmse: float
    noise: float
    noise_stated: float
    noise_source: str
    p_value: float
    significant: bool


@dataclass(frozen=True)
class Region:
    """A box in which the bench differs from the refitted base model.

    Attributes:
        limits: (low, high) by the name of the axis, SI.
        mean_residual: measured - predicted of the first channel, mean over the box.
        samples: in the box.
        p_value: family-wise, over all boxes looked at.
        channel: the reading that shows it most clearly.
    """

    limits: Mapping[str, tuple[float, float]]
    mean_residual: float
    samples: int
    p_value: float
    channel: str


@dataclass(frozen=True)
class Cause:
    """One effect as a cause of the gap.

    Attributes:
        effect: its name; `form` its form.
        component: the part it belongs to.
        probability: that it is present.
        indistinguishable_from: effects that these data cannot tell from it: the rest of the
            smallest set that holds the cause with 80 %, given that it is a listed one.
        together_with: the other effects of its most probable set, in words, or None.
        parameters: fitted values by name; sizes come with `interval` (95 %), `unit`, `plausible`.
        gap_after: root of the mean squared error above noise once it is added.
        shrinkage: 1 - G2_after / G2_before for it by cross-validation, held as the effect in every
            fold; None without a gap.
        drift: change of each base parameter when it is added, in words and numbers.
        summary: what it does, in plain words; `source` of its form; `remedy` that settles it.
        model: the base model refitted with it, for the channels that it serves.
    """

    effect: str
    form: str
    component: str
    probability: float
    indistinguishable_from: tuple[str, ...]
    together_with: str | None
    parameters: dict[str, dict[str, Any]]
    gap_after: float
    shrinkage: float | None
    drift: dict[str, dict[str, float]]
    summary: str
    source: str
    remedy: str
    model: Any = field(repr=False)


@dataclass(frozen=True)
class CauseSet:
    """A set of effects that together may be all of the gap.

    Attributes:
        effects: names, sorted.
        probability: that it is these and no others.
        gap_after, shrinkage: as of a `Cause`, with all of them added; None beyond the first five.
    """

    effects: tuple[str, ...]
    probability: float
    gap_after: float | None
    shrinkage: float | None


@dataclass(frozen=True)
class Delivered:
    """Errors of the models handed over, at samples left out, as the meters of the bench read.

    Attributes:
        rmse_before: of the refitted base model.
        rmse_after: of the model that is saved.
    """

    rmse_before: float
    rmse_after: float


@dataclass(frozen=True)
class ShrinkageSummary:
    """How far the gap shrinks.

    By cross-validation it is that of the leading set, held in every fold; on a holdout that of the
    model of the first cause.

    Attributes:
        before, after: root of the mean squared error above noise; 0 where below noise, but no less
            than what everything alive foretells of it (`gap_at`), as far as the noise hides it,
            where it is cross-validated.
        fraction: 1 - G2_after / G2_before, or None where there is no gap before.
        interval: of `fraction`, 95 %, or None.
        on: `cross-validation` or `holdout`.
    """

    before: float
    after: float
    fraction: float | None
    interval: tuple[float, float] | None
    on: str


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of a diagnosis; `words.Diagnosis` adds how it is told.

    Attributes:
        gap, where, causes, sets, shrinkage, delivered, next_tests, advice: see the classes above
            and `advice`.
        verdict: `no_gap`, `cause_found`, `ambiguous` or `unexplained`.
        unlisted: probability that listed effects are not all of the gap.
        misfit: of it, that a base model is a little off and nothing else.
        lost_power: what the leading set of causes costs on average over the samples [W], or the gap
            where no cause is named.
        warnings: why the readings may be of another machine, in plain sentences.
        notes: the same on the data and the search, the warnings first.
        base: the base model refitted to the samples, no effect added.
        alive: the explanations that matter; they foretell the gap at any operating point.
        samples: what was diagnosed.
        residuals: measured - predicted of the refitted base model at each of them, left out, (n,).
        judged: the samples by which the shrinkage is measured, of the holdout or the same;
            `residuals_before`, `residuals_after` are theirs.
    """

    gap: Gap
    where: tuple[Region, ...]
    verdict: str
    causes: tuple[Cause, ...]
    sets: tuple[CauseSet, ...]
    shrinkage: ShrinkageSummary
    delivered: Delivered
    next_tests: tuple[NextTest, ...]
    advice: Advice
    unlisted: float
    misfit: float
    lost_power: float
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    base: Any
    alive: Posterior
    samples: Any
    residuals: Array
    judged: Any
    residuals_before: Array
    residuals_after: Array

    @property
    def _observed(self) -> Observations:
        return self.alive.base_only.fit.observed

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Of the operating points."""
        return self._observed.steered

    @property
    def extent(self) -> dict[str, tuple[float, float]]:
        """How far the samples reach along each of `axes`."""
        return {
            axis.name: (float(row.min()), float(row.max()))
            for axis, row in zip(self.axes, self._observed.coordinates, strict=True)
        }

    @property
    def channel(self) -> Channel:
        """The one in which the gap is measured."""
        return self._observed.channels[0]

    def gap_at(
        self, *place: Array | float, **named: Array | float
    ) -> tuple[Array, Array]:
        """Return mean and standard deviation of the gap at any operating point.

        Measured minus refitted base, averaged over the explanations alive, the unlisted among them;
        NaN where the model has no answer.

        Args:
            place: a value along each of `axes`, in their order; arrays are broadcast.
            named: the same by the name of the axis; of an axis that is only recorded the median of
                the samples, if left out.

        Raises:
            InputError: a value is missing, or there is no such axis.
        """
        observed = self._observed
        given = {
            **dict(zip((axis.name for axis in self.axes), place, strict=False)),
            **named,
        }
        known = [axis.name for axis in observed.axes]
        for name in (*(axis.name for axis in self.axes), *named):
            if name not in given or name not in known:
                raise InputError(
                    f"gap_at needs {', '.join(known)}: {name} is "
                    f"{'unknown' if name in given else 'missing'}"
                )
        values = np.broadcast_arrays(
            *(
                np.asarray(
                    given.get(name, np.median(observed.points[name])), dtype=float
                )
                for name in known
            )
        )
        mean, deviation = self.alive.gap_at(
            dict(zip(known, map(np.ravel, values), strict=True))
        )
        return mean.reshape(values[0].shape), deviation.reshape(values[0].shape)

    @property
    def merely_off(self) -> bool:
        """Whether the gap is most likely a base model that is a little off, and nothing else."""
        return self.misfit > self.unlisted / 2.0 > 0.25

    @property
    def named(self) -> Cause | None:
        """The leading cause, if the verdict names one."""
        return self.causes[0] if self.causes and self.verdict in NAMING else None

    @property
    def component(self) -> str | None:
        """The part in which the leading cause acts."""
        return self.named.component if self.named else None

    @property
    def model(self) -> Any:
        """The model to use from now on: with the leading set of causes if one was found."""
        return self.named.model if self.named else self.base
