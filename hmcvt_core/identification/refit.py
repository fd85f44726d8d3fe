# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A refit of the model in service that can do no harm: what the samples do not say, it keeps.

1. Which samples belong together: least trimmed squares find the parameters that the better half of
   the samples agrees on; the scatter about them tells which others do not belong, and those are set
   aside [Rousseeuw & Leroy 1987, Robust Regression and Outlier Detection, ch. 5]. Samples at one
   working point have one vote together.
2. What they say: the information of the others, measured in the width of what was known before (the
   covariance of the model in service, and the wear that hydraulics may have: `PRIOR_SPREAD`), falls
   into three independent directions. In each the change has a significance t, the least that is
   left when any one working point is taken away.
3. What is followed: the prior is the model in service; its variance in each direction is the
   smallest under which the change lies within c standard deviations, c two or the like quantile of
   Student's t (covariance inflation of an adaptive Kalman filter [Jazwinski 1969, Automatica 5]).
   That follows 1 - c2/t2 of a change: wear, though the prior be tight; no noise, though it be wide.
   A model that states no errors and is refuted in one direction is followed in all of them as far
   as is most probable, with the wear as prior: nothing speaks for it.
4. Whether that may serve: `Refit.refused` says what speaks against it. One thing is whether it
   predicts samples that it has not seen as well as the model in service does (`cross_validate`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import IdentificationError
from ..files.bench import BenchSamples
from ..model.agreement import (
    carried_at,
    gear_train_remarks,
    mean_error,
    relative_errors,
)
from ..model.domain import AXES, Domain
from ..model.model import EfficiencyModel
from ..transmission.parameters import PAPER_EFFICIENCY_UNCERTAINTY, PARAMETER_NAMES
from ..transmission.ranges import OperatingPoints
from .evidence import MEDIAN_TO_DEVIATION, Campaign
from .identify import origin
from .problem import findings

MAX_DRIFT = 0.10
"""A unit whose leakage has doubled and whose dampings have grown by half lies 3 to 6 points below
a new one on average; one that is further off is another one, or its bench is."""
FOLDS = 5
FEWEST = len(PARAMETER_NAMES) + 1
"""Fewest samples that can spare one; fewer cannot determine the parameters without it."""

_NOISIEST = 3.0  # benches, in terms of the paper's; beyond that it is no noise
_ALLOWANCE = 2.0
_MOST_SET_ASIDE = 1.0 / 3.0  # of the samples; with more no majority is to be trusted
_NOTICED = 0.01  # change of an efficiency that has to be supported by the samples
_CERTAIN = 2.0  # standard errors
_NAMED = 20  # samples with a sentence of their own
_GRID = (11, 5, 5)


@dataclass(frozen=True)
class CrossValidation:
    """Outcome of the comparison; every error is a mean of |predicted - measured| / measured [-].

    Attributes:
        samples: how many, each predicted once by a refit that has not seen it.
        folds: how many refits predicted them.
        error_refit: of these refits.
        error_in_service: of the model in service, at the same samples.
        allowance: by how much the first may exceed the second.
        change: mean of |refit to all samples - model in service| / measured.
    """

    samples: int
    folds: int
    error_refit: float
    error_in_service: float
    allowance: float
    change: float

    @property
    def worse(self) -> bool:
        """Whether the refit is worse by more than noise explains."""
        return (
            self.error_refit - self.error_in_service > self.allowance
            and self.change > self.allowance
        )


@dataclass(frozen=True, eq=False)
class Refit:
    """A model fitted to samples with the one in service as prior, and whether it may serve.

    Attributes:
        model: the refit; what the samples do not determine is that of the model in service.
        set_aside: samples that disagree with the rest, from 1 in their order.
        kept: sentences on what was kept from the model in service.
        refused: one line, what speaks against adopting it; empty when nothing does.
        largest_change: of an efficiency within the domain, against the model in service [-].
        drift: mean change of the efficiency within the domain against the base model [-].
        warnings: sentences on the samples set aside and on what is left open.
        held_back: the comparison on samples held back, None with fewer than four to compare.
        error_before, error_after: mean |predicted - measured| / measured of the model in service
            and of the refit, over all samples [-].
    """

    model: EfficiencyModel
    set_aside: tuple[int, ...]
    kept: tuple[str, ...]
    refused: str
    largest_change: float
    drift: float
    warnings: tuple[str, ...]
    held_back: CrossValidation | None
    error_before: float
    error_after: float


def refit(
    samples: BenchSamples,
    served: EfficiencyModel,
    base: EfficiencyModel,
    *,
    seed: int = 0,
    max_drift: float = MAX_DRIFT,
) -> Refit:
    """Fit the model in service to samples.

    Args:
        samples: of the bench; samples at one working point count as one.
        served: the model in service: stage, formulation, effects and prior.
        base: model against which drift is measured, the one that the first refit began with.
        seed: of the random numbers.
        max_drift: largest mean change of the efficiency against `base` within the domain [-]; not
            for a base that does not state its errors: it is no measure of the unit.

    Raises:
        IdentificationError: fewer working points than parameters, or no answer at the samples.
    """
    campaign = Campaign(served, samples)
    points = len(set(campaign.places.tolist()))
    if points < len(PARAMETER_NAMES):
        raise IdentificationError(
            f"{samples.source}: {len(samples)} samples at {points} distinct working "
            f"point{'s' * (points > 1)} cannot determine {len(PARAMETER_NAMES)} parameters; a "
            f"refit needs at least {len(PARAMETER_NAMES)} points"
        )
    fit, belongs = campaign.majority(seed)
    used = replace(campaign, samples=samples.select(belongs))
    if not np.isfinite(used.predict(fit)).all():
        raise IdentificationError(
            f"{samples.source}: no parameters within the bounds give an efficiency at most of the "
            "samples: check stage, units and load torque"
        )
    evidence = used.evidence(fit)
    model = used.follow(evidence)
    fold = folds(used.samples, seed)
    others = [
        replace(used, samples=used.samples.select(fold != part)).follow(evidence)
        for part in range(fold.max() + 1)
    ]
    held_back = (
        cross_validate(used.samples, model, served, fold, others) if others else None
    )
    # The smallest box that holds the samples and the domain of the model in service.
    box = Domain.of(used.samples)
    pairs = [getattr(box, axis) + getattr(served.domain or box, axis) for axis in AXES]
    domain = Domain(*((min(ends), max(ends)) for ends in pairs))
    axes = [
        np.linspace(min(ends), max(ends), number)
        for ends, number in zip(pairs, _GRID, strict=True)
    ]
    grid = OperatingPoints(*map(np.ravel, np.meshgrid(*axes, indexing="ij")))
    after, before, first = (carried_at(each, grid) for each in (model, served, base))
    change, drift = after - before, float(np.abs(after - first).mean())
    limit = max_drift if base.standard_errors else np.inf
    measured, aside = samples.efficiency, np.flatnonzero(~belongs)

    def objections() -> Iterator[str]:
        """Say what speaks against the refit."""
        if len(aside) > _MOST_SET_ASIDE * len(samples):
            yield (
                f"{len(aside)} of {len(samples)} samples disagree with the others, more than a "
                "third: none can be trusted"
            )
        if held_back is not None and held_back.worse:
            yield (
                "the refit is worse on samples held back: mean error "
                f"{100 * held_back.error_refit:.2f} %, model in service "
                f"{100 * held_back.error_in_service:.2f} %"
            )
        # One that does not state its errors is, once refuted, worth no more than the refit.
        if others and campaign.prior.stated:
            # Jackknife of groups.
            parts = np.array([carried_at(each, grid) for each in others])
            doubt = _CERTAIN * np.sqrt((len(parts) - 1) * parts.var(axis=0))
            excess = np.where(
                np.abs(change) > _NOTICED, doubt - np.abs(change), -np.inf
            )
            worst = int(excess.argmax())
            if excess[worst] > 0.0:
                stroke, speed, load = (axis[worst] for axis in grid[:3])
                yield (
                    f"the refit would move the efficiency by {100 * change[worst]:+.1f} points "
                    f"at displacement ratio {stroke:.2f}, {speed:.1f} rad/s, {load:.0f} N m, "
                    f"where the samples held back allow a doubt of {100 * doubt[worst]:.1f} "
                    "points"
                )
        if drift > limit:
            yield (
                f"the refit would differ from the base model by {100 * drift:.1f} points on "
                f"average, more than the {100 * limit:.3g} points allowed"
            )

    expected = campaign.predict(fit)
    warnings = [
        *gear_train_remarks(served, samples),
        *(
            f"sample {i + 1} is set aside: it reads {measured[i]:.4g}, the rest of the samples say "
            f"{expected[i]:.4g}"
            for i in aside[:_NAMED]
        ),
        *(
            []
            if len(aside) <= _NAMED
            else [f"{len(aside) - _NAMED} more samples are set aside like these"]
        ),
        *(
            []
            if drift <= 0.5 * limit
            else [
                f"the refit differs from the base model by {100 * drift:.1f} points on average, the "
                f"limit is {100 * limit:.3g}"
            ]
        ),
        *findings(used.samples, model),
        *(
            []
            if held_back is not None
            else [
                f"fewer than {FEWEST} samples: none could be held back to check the refit"
            ]
        ),
    ]
    errors = [
        mean_error(each.efficiency(*samples.points), measured)
        for each in (served, model)
    ]
    provenance = {
        **{name: told for name, told in served.provenance.items() if name == "units"},
        **origin("refit", samples, seed),
        "set_aside": len(aside),
        "fit_error": float(f"{errors[1]:.6g}"),
    }
    return Refit(
        replace(model, domain=domain, provenance=provenance),
        tuple((aside + 1).tolist()),
        evidence.kept(campaign.prior),
        next(objections(), ""),
        float(np.abs(change).max()),
        drift,
        tuple(warnings),
        held_back,
        *errors,
    )


def cross_validate(
    samples: BenchSamples,
    refit: EfficiencyModel,
    in_service: EfficiencyModel,
    fold: NDArray[np.intp],
    others: Sequence[EfficiencyModel],
) -> CrossValidation:
    """Compare a refit with the model in service on samples that it has not seen.

    Noise decides over small differences, so the refit is called worse only when it is worse by more
    than an allowance, and when it answers differently by more than that. A fit of p parameters to n
    samples flatters itself by about p / n of the noise against new samples, and the model in
    service may be such a fit to these very samples; the allowance is twice that. Without the second
    condition a refit of unchanged samples, which gives the model in service again, could be called
    worse than it.

    Args:
        samples: that `refit` was fitted to.
        refit: the model fitted to all of them.
        in_service: the model to beat.
        fold: of each sample, see `folds`.
        others: for each fold, the refit to the samples that are not in it.
    """
    measured, unseen = samples.efficiency, np.empty(len(samples))
    for part, other in enumerate(others):
        unseen[fold == part] = carried_at(other, samples.select(fold == part).points)
    served, refitted = (
        carried_at(in_service, samples.points),
        carried_at(refit, samples.points),
    )
    errors = relative_errors(served, measured)
    # The noise as the better of the two models sees it. From medians, so that a few bad samples do
    # not pass for noise and excuse the refit they spoil; not below what the paper's bench has: a
    # fit to a handful of samples leaves no residual.
    noise = float(
        np.clip(
            MEDIAN_TO_DEVIATION
            * min(np.median(errors), np.median(relative_errors(refitted, measured))),
            PAPER_EFFICIENCY_UNCERTAINTY,
            _NOISIEST * PAPER_EFFICIENCY_UNCERTAINTY,
        )
    )
    return CrossValidation(
        len(samples),
        len(others),
        float(relative_errors(unseen, measured).mean()),
        float(errors.mean()),
        float(_ALLOWANCE * len(PARAMETER_NAMES) / len(samples) * noise),
        float(np.mean(np.abs(refitted - served) / measured)),
    )


def folds(samples: BenchSamples, seed: int) -> NDArray[np.intp]:
    """Deal n samples into folds of like displacement ratios; their numbers, shape (n,).

    Power circulates on one side of zero and not on the other: a fit that has seen one side only
    says little about the other. With four or five samples a fold is one of them; fewer than
    `FEWEST` are dealt into none, -1.
    """
    count, number = len(samples), min(len(samples), FOLDS)
    fold = np.full(count, -1)
    if count >= FEWEST:
        rng = np.random.default_rng(seed)
        fold[np.argsort(samples.displacement_ratio, kind="stable")] = np.concatenate(
            [rng.permutation(number) for _ in range(0, count, number)]
        )[:count]
    return fold
