# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The outcome of a diagnosis as values; nothing is inferred here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, TypeVar

import numpy as np

from ...errors import InputError
from ..design.advice import Advice, NextTest
from ..observations import SESSION, Observations
from ..selection.classes import ClassSet, EffectClass, merge_sets
from ..selection.explanation import Explanation
from ..selection.posterior import Posterior
from ..settings import LIKELY, REGION_SIGNIFICANCE
from ..statements.agreement import NOTHING_STATED, Agreement
from ..statements.members import Member
from ..statements.scatter import ExcessScatter
from ..system import Array, Axis, Channel

NAMING = ("cause_found", "class_found", "other_form", "ambiguous")
"""Verdicts that name a cause, a class of causes, or a cause whose form is not in the library."""


@dataclass(frozen=True)
class Gap:
    """Size and significance of the gap after the base parameters are refitted.

    Sizes are in the unit of the first channel, the efficiency of a transmission.

    Attributes:
        samples: number of samples.
        rmse: of the refitted base model at samples left out of the fit, without the errors of
            meters that the diagnosis expects.
        noise: standard deviation, as the diagnosis estimates it.
        noise_stated: as given or assumed.
        noise_source: where `noise_stated` comes from.
        p_value: probability that no gap shows as much anywhere.
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
        mean_residual: estimated gap of the first channel, measured - predicted, mean over the
            samples in the box.
        samples: number of samples in the box.
        p_value: probability, given a gap, that this mean has the opposite sign.
        channel: the reading that shows the difference most clearly.
        setting: label along an axis that has labels, as the stage, where the box is limited to one.
    """

    limits: Mapping[str, tuple[float, float]]
    mean_residual: float
    samples: int
    p_value: float
    channel: str
    setting: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Cause:
    """One effect as a cause of the gap.

    Attributes:
        effect: name of the effect.
        form: name of its form.
        component: the part it belongs to.
        probability: that it is present.
        indistinguishable_from: effects that these data cannot distinguish from it: the rest of the
            smallest set that holds the cause with 80 %, given that it is a listed one.
        together_with: the other effects of its most probable set, in words, or None.
        parameters: fitted values by name with `unit` and `meaning`; sizes also have
            `standard_error`, `interval` (95 %) and `plausible`.
        gap_after: root of the mean squared error above noise once it is added.
        shrinkage: 1 - G2_after / G2_before by cross-validation, with the effect held in every
            fold; None without a gap.
        drift: change of each base parameter when the effect is added.
        summary: what the effect does, in plain words.
        source: of its form.
        remedy: the measurement that settles it.
        model: the base model refitted with it, for the channels that it serves.
        has_fixed_shapes: whether the intervals hold at the values of some shapes: those that are
            constants or are tried at a few values, and all of less likely effects.
        may_be_absent: whether its size is zero within its error at the fitted shapes.
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
    has_fixed_shapes: bool = False
    may_be_absent: bool = False

    @property
    def coverage(self) -> str:
        """What the interval of its size covers: other shapes would give other sizes."""
        return "95 % at the fixed shapes" if self.has_fixed_shapes else "95 %"


@dataclass(frozen=True)
class CauseSet:
    """A set of effects that together may be all of the gap.

    Attributes:
        effects: names, sorted.
        probability: that these effects are present and no others.
        gap_after: as of a `Cause`, with all of them added; None beyond the first five.
        shrinkage: as of a `Cause`, with all of them added; None beyond the first five.
        alternatives: for each effect the members of its class, which no test distinguishes from
            it, or its name alone.
        class_probability: of all sets that differ from it only within classes, itself included.
    """

    effects: tuple[str, ...]
    probability: float
    gap_after: float | None
    shrinkage: float | None
    alternatives: tuple[tuple[str, ...], ...] = ()
    class_probability: float | None = None


BASE = "base"
LEADING_SET = "leading set"
AVERAGE = "average"
"""Kinds of models that are handed over."""


@dataclass(frozen=True)
class Delivered:
    """The model that is handed over, and errors at samples left out of the fit.

    The errors of the meters that the diagnosis expects are taken off the readings, before and after
    alike.

    Attributes:
        rmse_before: of the refitted base model.
        rmse_after: of the model that is handed over.
        kind: what that is: `base`, `leading set`, or the `average` over all explanations.
        bumps: number of bumps of an empirical remainder in it.
    """

    rmse_before: float
    rmse_after: float
    kind: str = BASE
    bumps: int = 0


@dataclass(frozen=True)
class ShrinkageSummary:
    """How far the gap shrinks.

    It is that of the model that is handed over: saved, exported and served.

    Attributes:
        before: root of the mean squared error above noise of the base model; 0 where it is below
            the noise, but by cross-validation at least the gap that all explanations expect.
        after: the same of the model handed over.
        fraction: 1 - G2_after / G2_before, 0 where the base model is handed over, or None where
            there is no gap before.
        interval: of `fraction`, 95 %, or None.
        on: `cross-validation` or `holdout`.
    """

    before: float
    after: float
    fraction: float | None
    interval: tuple[float, float] | None
    on: str

    @property
    def grows(self) -> bool:
        """Whether the gap is larger with a model that samples left out may refuse.

        A holdout judges the model and does not choose it.
        """
        is_choice = self.on == "cross-validation"
        return is_choice and self.fraction is not None and self.fraction < 0.0


@dataclass(frozen=True, eq=False)
class Measurement:
    """How far the gap shrinks with a model, and its errors at the m samples that show it.

    Attributes:
        shrinkage: of the model.
        samples: the system's record of the samples.
        before: errors of the base model, shape (m,).
        after: errors of the model, shape (m,).
        notes: on samples that do not count.
    """

    shrinkage: ShrinkageSummary
    samples: Any
    before: Array
    after: Array
    notes: tuple[str, ...] = ()


Predict = Callable[[Any], Array]
"""Predicts the first channel at samples as the system records them."""


class Judge(Protocol):
    """Measures how far the gap of a campaign shrinks with any model.

    Attributes:
        on: what it measures on, `cross-validation` or `holdout`.
    """

    on: str

    def measured(self, explanation: Explanation) -> Measurement:
        """Return how far the gap shrinks with the model of an explanation, and its errors."""

    def measured_model(self, predict: Predict, left_out: Array) -> Measurement:
        """Return how far the gap shrinks with a model, and its errors.

        Args:
            predict: the first channel at samples, by the model fitted to the whole campaign.
            left_out: errors of the model at samples of the campaign left out of the fit, shape
                (assignments, n).
        """


@dataclass(frozen=True)
class ParameterEstimate:
    """A fitted base parameter.

    Attributes:
        value: in its unit.
        standard_error: linearised at the fit, in the same unit.
        unit: of both; empty where the system states none.
    """

    value: float
    standard_error: float
    unit: str


@dataclass(frozen=True)
class SharedErrorEstimate:
    """An error that readings share, as of a meter in one session.

    Attributes:
        error: what is off, in words.
        session: name of the session; empty where all readings share it.
        value: posterior mean, over all explanations of the readings.
        standard_deviation: of the posterior.
        expected: standard deviation before any reading, by the class of the meter.
        unit: of the three.
    """

    error: str
    session: str
    value: float
    standard_deviation: float
    expected: float
    unit: str


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of a diagnosis; `Diagnosis` adds text, plain data and a picture.

    Attributes:
        gap: size and significance of the gap.
        where: regions in which the bench differs from the refitted base model.
        verdict: `no_gap`, `excess_scatter`, `cause_found`, `class_found`, `other_form`,
            `ambiguous` or `unexplained`; `statements.verdict` has the rule of each.
        causes: effects that may be present, those of the leading set first.
        sets: sets of effects, most probable first.
        classes: effects that no test distinguishes, most probable class first.
        shrinkage: how far the gap shrinks with the model that is handed over.
        delivered: errors of the models before and after.
        next_tests: tests and measurements that distinguish what is still open.
        advice: what to measure next, or why to stop.
        unlisted: probability that listed effects are not all of the gap.
        misfit: of it, that the base model is a little off and nothing else.
        lost_power: mean power that the named causes take over the samples [W]; None where none is
            named, or its form is not known.
        warnings: why the readings may be of another machine, in plain sentences.
        notes: on the data and the search, the warnings first.
        base: the base model refitted to the samples, no effect added.
        posterior: over the relevant explanations; it predicts the gap at any point.
        samples: what was diagnosed.
        residuals: measured - predicted of the refitted base model at samples left out, shape (n,).
        judged: the samples by which the shrinkage is measured, of the holdout or the same, m of
            them.
        residuals_before: residuals of the base model at those, shape (m,).
        residuals_after: residuals of the model handed over, shape (m,).
        base_parameters: of the refitted base model, by name.
        parameters: of `model`, by name.
        seed: of every random number.
        shared_errors: errors of the meters that readings share, session by session.
        agreement: readings against their stated noise.
        scatter: scatter above its statement that no axis explains, or None.
        members: effects and classes that may be present whatever else is, most probable first.
        set_is_settled: whether the leading set, or its class set, is probable as a whole.
        left_out: samples that stand alone against their neighbours and were left out, in words.
        served: the model that is handed over, saved and served; None for the one with the leading
            set, or the base model where no cause is named.
        leading: explanation of the first of `sets`; None where there is none.
        headline: sentence for the mechanic where the bench gives a better one; empty for none.
        second_line: sentence that reports print below that one, such as how much a loss has grown;
            empty for none.
        judge: measures how far the gap shrinks with any other model.
    """

    gap: Gap
    where: tuple[Region, ...]
    verdict: str
    causes: tuple[Cause, ...]
    sets: tuple[CauseSet, ...]
    classes: tuple[EffectClass, ...]
    shrinkage: ShrinkageSummary
    delivered: Delivered
    next_tests: tuple[NextTest, ...]
    advice: Advice
    unlisted: float
    misfit: float
    lost_power: float | None
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    base: Any
    posterior: Posterior
    samples: Any
    residuals: Array
    judged: Any
    residuals_before: Array
    residuals_after: Array
    base_parameters: Mapping[str, ParameterEstimate]
    parameters: Mapping[str, ParameterEstimate]
    seed: int = 0
    shared_errors: tuple[SharedErrorEstimate, ...] = ()
    agreement: Agreement = NOTHING_STATED
    scatter: ExcessScatter | None = None
    members: tuple[Member, ...] = ()
    set_is_settled: bool = False
    left_out: tuple[str, ...] = ()
    served: Any = None
    leading: Explanation | None = field(default=None, repr=False)
    headline: str = ""
    second_line: str = ""
    judge: Judge | None = field(default=None, repr=False)

    @property
    def significant_region(self) -> Region | None:
        """The first of `where`, whose sign is certain; None where there is none."""
        for region in self.where:
            if region.p_value <= REGION_SIGNIFICANCE:
                return region
        return None

    @property
    def alive(self) -> Posterior:
        """Earlier name of `posterior`."""
        return self.posterior

    @property
    def _observed(self) -> Observations:
        return self.posterior.base_only.fit.observed

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Axes of the operating points that a test can set."""
        return self._observed.steered

    @property
    def extent(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest value of the samples along each of `axes`."""
        extent = {}
        for axis, values in zip(self.axes, self._observed.coordinates, strict=True):
            extent[axis.name] = (float(values.min()), float(values.max()))
        return extent

    @property
    def channel(self) -> Channel:
        """The channel in which the gap is measured."""
        return self._observed.channels[0]

    def gap_at(
        self, *coordinates: Array | float, **named: Array | float
    ) -> tuple[Array, Array]:
        """Return mean and standard deviation of the gap at any operating point.

        Measured minus refitted base, averaged over the relevant explanations, unlisted losses among
        them.

        Args:
            coordinates: a value along each of `axes`, in their order; arrays are broadcast.
            named: the same by the name of the axis; an axis that is only recorded may be left out
                and takes the median of the samples.

        Returns:
            Mean and standard deviation in the unit of `channel`; NaN where the model has no answer.

        Raises:
            InputError: a value is missing, or there is no such axis.
        """
        observed = self._observed
        steered = [axis.name for axis in self.axes]
        # A coordinate that all samples share is recorded without an axis.
        known = [name for name in observed.points if name != SESSION]
        given = {**dict(zip(steered, coordinates, strict=False)), **named}
        for name in steered:
            if name not in given:
                raise InputError(f"gap_at needs {', '.join(known)}: {name} is missing")
        for name in named:
            if name not in known:
                raise InputError(f"gap_at needs {', '.join(known)}: {name} is unknown")
        values = []
        for name in known:
            usual = np.median(observed.points[name])
            values.append(np.asarray(given.get(name, usual), dtype=float))
        rows = np.broadcast_arrays(*values)
        points = {name: row.ravel() for name, row in zip(known, rows, strict=True)}
        mean, deviation = self.posterior.gap_at(points)
        shape = rows[0].shape
        return mean.reshape(shape), deviation.reshape(shape)

    @property
    def class_sets(self) -> tuple[ClassSet, ...]:
        """`sets` merged where they differ only by members of a class, most probable first."""
        sets = [(item.effects, item.probability) for item in self.sets]
        return merge_sets(sets, self.classes)

    def class_of(self, cause: Cause) -> EffectClass | None:
        """Return the class of a cause, if tests do not distinguish it from others."""
        for item in self.classes:
            if (cause.effect, cause.form) in zip(item.members, item.forms, strict=True):
                return item
        return None

    def twins_of(self, effects: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
        """Return the sets that no test distinguishes from one of `sets`, itself included."""
        for item in self.class_sets:
            if effects in item.sets:
                return item.sets
        raise KeyError(effects)

    @property
    def merely_off(self) -> bool:
        """Whether the gap is most likely a base model that is a little off, and nothing else."""
        return self.misfit > self.unlisted / 2.0 > LIKELY / 2.0

    @property
    def named(self) -> Cause | None:
        """The leading cause, if the verdict names one."""
        if self.causes and self.verdict in NAMING:
            return self.causes[0]
        return None

    @property
    def present(self) -> tuple[Member, ...]:
        """The members that are causes, although others may join them."""
        return tuple(item for item in self.members if item.is_present)

    @property
    def component(self) -> str | None:
        """The part in which the leading cause acts; None where members of its class differ."""
        if self.named is None:
            return None
        for item in self.members:
            if self.named.effect in item.effects and self.verdict == "class_found":
                return item.component
        return self.named.component

    @property
    def model(self) -> Any:
        """The model to use: the one handed over, else with the leading set if one is named."""
        if self.served is not None:
            return self.served
        return self.named.model if self.named else self.base


AnyOutcome = TypeVar("AnyOutcome", bound=Outcome)


def keeping_base(outcome: AnyOutcome) -> AnyOutcome:
    """Return an outcome with the refitted base model as the one that is handed over."""
    if outcome.judge is None or not outcome.gap.significant:
        return outcome
    measurement = outcome.judge.measured(outcome.posterior.base_only)
    before = outcome.delivered.rmse_before
    return replace(
        outcome,
        shrinkage=measurement.shrinkage,
        residuals_after=measurement.after,
        delivered=Delivered(before, before),
        parameters=outcome.base_parameters,
        served=outcome.base,
    )
