# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The steps of a diagnosis, as docs/diagnosis-method.md describes them.

prepare: which samples can be used, and the base model refitted to them;
detect: is there a gap;
select: which explanations are how probable;
measure: how far the gap shrinks, at samples left out;
advise: which test to run next;
summarise: verdict, causes, regions, parameters, notes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from ..files.checks import require_seed
from .analysis import Analysis, model_of, rms
from .design.advice import Advice
from .design.next_test import advise, within_range
from .detection.regions import candidate_regions
from .detection.significance import significance
from .observations import Observations
from .preparation import prepare
from .results.diagnosis import Diagnosis
from .results.notes import base_notes, noise_notes
from .results.outcome import (
    BASE,
    LEADING_SET,
    NAMING,
    AnyOutcome,
    Delivered,
    Gap,
    keeping_base,
)
from .results.shrinkage import CrossValidation, Holdout
from .results.summary import (
    causes_of,
    lost_power_of,
    parameters_of,
    sets_of,
    shared_errors_of,
)
from .results.where import regions_of
from .selection.classes import find_classes
from .selection.posterior import compute_posterior
from .statements.agreement import agreement_of
from .statements.members import members_of
from .statements.verdict import set_is_settled, verdict_of
from .system import Points, System


def diagnose_system(
    system: System,
    observed: Observations,
    held_out: Observations | None = None,
    *,
    warnings: Sequence[str] = (),
    notes: Sequence[str] = (),
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Diagnose the gap between the model of a system and a bench.

    The base parameters are refitted first: a gap that a refit closes is no gap.

    Args:
        system: what is on the bench.
        observed: at least five samples, and more than there are base parameters.
        held_out: samples to measure the shrinkage on; None for cross-validation.
        warnings: why the readings may be of another machine; they precede everything else.
        notes: on the samples, to precede other notes.
        seed: of every random number.
        progress: called with a line of text before each step; may raise to cancel.

    Returns:
        The diagnosis; `report()` prints it, `to_dict()` gives plain data, `plot()` a picture.

    Raises:
        InputError: samples cannot carry a diagnosis.
    """

    def report_step(text: str) -> None:
        if progress is not None:
            progress(text)

    require_seed(seed)
    base, preparation_notes, outliers = prepare(system, observed)
    boxes = candidate_regions(base.observed.coordinates)
    report_step("step 1 of 3, is there a gap")
    detection = significance(base, boxes, seed)
    report_step("step 2 of 3, refits with sets of effects")
    posterior = compute_posterior(base, boxes, seed)
    classes = find_classes(posterior)
    analysis = Analysis(posterior, boxes, detection, seed, classes)
    report_step("step 3 of 3, how far the gap shrinks")
    validation = CrossValidation(analysis)
    judge: CrossValidation | Holdout = validation
    if held_out is not None:
        judge = Holdout(analysis, held_out)
    possible = system.candidates(base.observed.points, base.base)
    advice = advise(posterior, possible, classes)
    first_notes = (*warnings, *notes, *preparation_notes)
    diagnosis = _summarise(
        analysis, validation, judge, advice, tuple(warnings), first_notes
    )
    if diagnosis.shrinkage.grows:
        diagnosis = keeping_base(diagnosis)
    return replace(diagnosis, left_out=outliers)


def _summarise(
    analysis: Analysis,
    validation: CrossValidation,
    judge: CrossValidation | Holdout,
    advice: Advice,
    warnings: tuple[str, ...],
    first_notes: tuple[str, ...],
) -> Diagnosis:
    """Put everything that was inferred of a campaign into one object."""
    posterior = analysis.posterior
    base_only = posterior.base_only
    observed = base_only.fit.observed
    system = base_only.fit.hypothesis.system
    agreement = agreement_of(base_only.fit)
    members = members_of(analysis)
    verdict, verdict_notes, scatter = verdict_of(analysis, agreement, members)
    settled = set_is_settled(analysis)
    residuals = validation.base_errors
    residuals_after = residuals
    base_parameters = parameters_of(base_only, base_only.fit)
    parameters = base_parameters
    if verdict in NAMING and analysis.posterior.sets:
        leading, _ = analysis.leading
        residuals_after = validation.errors(leading)
        parameters = parameters_of(leading, leading.served_fit)
        measurement = judge.measured(leading)
        kind = LEADING_SET
    else:
        measurement = judge.measured(base_only)
        kind = BASE
    return Diagnosis(
        gap=Gap(
            samples=len(residuals),
            rmse=rms(residuals),
            noise=rms(analysis.noise),
            noise_stated=observed.stated_noise,
            noise_source=observed.noise_source,
            p_value=analysis.detection.p_value,
            significant=analysis.significant,
        ),
        where=regions_of(analysis),
        verdict=verdict,
        causes=causes_of(analysis, validation, verdict),
        sets=sets_of(analysis, validation),
        classes=analysis.classes if analysis.significant else (),
        shrinkage=measurement.shrinkage,
        delivered=Delivered(rms(residuals), rms(residuals_after), kind),
        next_tests=advice.next_tests,
        advice=advice,
        unlisted=posterior.unlisted if analysis.significant else 0.0,
        misfit=posterior.misfit if analysis.significant else 0.0,
        lost_power=lost_power_of(analysis, members, verdict, settled),
        warnings=warnings,
        notes=(
            *first_notes,
            *measurement.notes,
            *noise_notes(analysis),
            *base_notes(analysis),
            *system.remarks(observed.samples),
            *verdict_notes,
        ),
        base=model_of(base_only, base_only.fit),
        posterior=posterior.relevant,
        samples=observed.samples,
        residuals=residuals,
        judged=measurement.samples,
        residuals_before=measurement.before,
        residuals_after=measurement.after,
        base_parameters=base_parameters,
        parameters=parameters,
        seed=analysis.seed,
        shared_errors=shared_errors_of(analysis),
        agreement=agreement,
        scatter=scatter,
        members=members,
        set_is_settled=settled,
        leading=analysis.leading[0] if analysis.has_candidates else None,
        judge=judge,
    )


def with_tests_in_range(outcome: AnyOutcome) -> AnyOutcome:
    """Return an outcome whose next tests lie within the range of its samples.

    The bench has shown that it can run these. Candidates and notes of the advice stay.
    """
    if not outcome.advice.tests:
        return outcome
    base = outcome.posterior.base_only.fit
    system = base.hypothesis.system
    points = base.observed.points
    possible = within_range(system.candidates(points, base.base), points, system.axes)
    inside = advise(outcome.posterior, possible, outcome.classes)
    advice = replace(
        outcome.advice,
        reason=inside.reason,
        tests=inside.tests,
        measure=inside.measure,
        parted=inside.parted,
        tests_expected=inside.tests_expected,
    )
    return replace(outcome, advice=advice, next_tests=advice.next_tests)


def next_test(
    system: System,
    observed: Observations,
    possible: Points | None = None,
    *,
    notes: Sequence[str] = (),
    seed: int = 0,
) -> Advice:
    """Choose the next test of a campaign.

    Args:
        system: what is on the bench.
        observed: at least five samples, and more than there are base parameters.
        possible: the tests that can be run; None for the candidates of the system.
        notes: on the samples, to precede other notes.
        seed: of every random number.

    Raises:
        InputError: samples cannot carry a diagnosis.
    """
    require_seed(seed)
    base, preparation_notes, _ = prepare(system, observed)
    if possible is None:
        possible = system.candidates(base.observed.points, base.base)
    boxes = candidate_regions(base.observed.coordinates)
    posterior = compute_posterior(base, boxes, seed)
    advice = advise(posterior, possible, find_classes(posterior))
    return replace(advice, notes=(*notes, *preparation_notes), seed=seed)
