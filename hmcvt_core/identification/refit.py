# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A refit of the model in service that keeps what the samples do not determine.

1. `robust`: which samples belong together. The others are rejected. Samples at one operating point
   have one vote together.
2. `update`: the directions that the samples determine, and how far each is followed. That follows
   wear, though the errors of the model in service be small, and ignores noise, though they be
   large. A model that states no errors and is refuted in one direction is followed in all of them.
3. `cross_validation`: whether the refit predicts samples that it has not seen as well as the model
   in service does.
4. `_CHECKS`: the first objection keeps the refit from service, see `Refit.refused`.
5. `_DOUBTS`: what a person has to decide, see `Refit.doubt`. A sender of most of the samples
   controls the refit, so that a change beyond wear, or a contradiction among the samples, is not
   adopted by a program.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import IdentificationError
from ..files.bench import BenchSamples
from ..files.checks import require_seed
from ..model.accuracy import carried_at, mean_error, relative_errors
from ..model.checks import require_model, require_samples
from ..model.domain import AXES, Domain
from ..model.model import EfficiencyModel
from ..model.plausibility import gear_train_remarks
from ..model.staged_samples import stage_of_each
from ..transmission.parameters import PARAMETER_NAMES
from ..transmission.ranges import Array, OperatingPoints
from .campaign import MAX_SET_ASIDE, origin, set_aside_remarks
from .cross_validation import (
    FEWEST,
    FOLDS,
    CrossValidation,
    cross_validate,
    folds,
)
from .misfit import misfit_remarks, with_misfit
from .remarks import undetermined
from .robust import MEDIAN_TO_DEVIATION, RobustProblem
from .update import Update

__all__ = ["FOLDS", "MAX_DRIFT", "Refit", "cross_validate", "folds", "refit"]

MAX_DRIFT = 0.10
"""Mean change of the efficiency that wear explains [-]: a unit whose leakage has doubled and whose
dampings have grown by half lies 3 to 6 points below a new one; one that is further off is another
unit, or its bench is wrong."""

MAX_CHANGE = 0.05
"""Largest change of an efficiency within the domain that is adopted without a person [-]: a unit
whose leakage has grown by half and whose dampings have grown by a fifth lies 4 points below."""

_NOTICED = 0.01  # change of an efficiency that has to be supported by the samples
_CERTAIN = 2.0  # standard errors
_CERTAIN_TREND = 4.0  # standard errors; a false alarm in 1 of 16,000 campaigns
_FEWEST_FOR_A_TREND = 8  # samples
_FEWEST_FOR_NOISE = 20  # samples, for a standard deviation good to a sixth
_FALSE_ALARM = 0.01  # chance that honest samples scatter so much more
_FRACTIONS = np.linspace(0.02, 0.6, 30)
"""Of the samples that may be of the model in service."""
_FAR_FROM_BOTH = 1e-3  # likelihood of a sample of neither state
_CERTAIN_MIXTURE = 6.6
"""Twice the log likelihood ratio; a false alarm in 1 of 200 campaigns."""
_BENCHES_DIFFER = 1.15  # noise of two campaigns; chosen on development campaigns
_MEAN_TO_DEVIATION = 1.2533
"""Mean of absolute values to standard deviation, normal distribution."""
_FEW_CONTRADICTIONS = 2  # one such reading is a mistake more often than not
_NEAR_LIMIT = 0.5  # fraction of the limit of the drift from which it is reported
_GRID = (11, 5, 5)
"""Points over displacement ratio, engine speed and load torque at which models are compared."""


@dataclass(frozen=True, eq=False)
class Refit:
    """A model fitted to samples with the one in service as prior, and whether it may serve.

    Attributes:
        model: the refit; what the samples do not determine is that of the model in service.
        set_aside: samples that disagree with the rest, from 1 in their order.
        kept: sentences on what was kept from the model in service.
        refused: one line, the objection against adopting it; empty without any.
        doubt: one line, why a person has to decide on a refit that is not refused; empty where none
            has to.
        largest_change: of an efficiency within the domain, against the model in service [-].
        drift: mean change of the efficiency within the domain against the base model [-].
        warnings: sentences on the rejected samples and on what is left open.
        held_back: the comparison on samples held out, None with fewer than four to compare.
        error_before: mean |predicted - measured| / measured of the model in service over all
            samples [-].
        error_after: the same of the refit.
        seed: of the random numbers.
    """

    model: EfficiencyModel
    set_aside: tuple[int, ...]
    kept: tuple[str, ...]
    refused: str
    doubt: str
    largest_change: float
    drift: float
    warnings: tuple[str, ...]
    held_back: CrossValidation | None
    error_before: float
    error_after: float
    seed: int = 0

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each parameter, in its unit."""
        return dict(self.model.standard_errors)

    def to_dict(self) -> dict[str, Any]:
        """Return the outcome as plain data for JSON."""
        held_back = None
        if self.held_back is not None:
            held_back = {**vars(self.held_back), "worse": self.held_back.worse}
        return {
            "parameters": self.model.to_mapping()["parameters"],
            "set_aside": list(self.set_aside),
            "refused": self.refused or None,
            "doubt": self.doubt or None,
            "largest_change": self.largest_change,
            "drift": self.drift,
            "error_before": self.error_before,
            "error_after": self.error_after,
            "held_back": held_back,
            "kept": list(self.kept),
            "warnings": list(self.warnings),
            "seed": self.seed,
        }

    def report(self) -> str:
        """Return the outcome as text."""
        lines = []
        values = self.model.parameters.to_mapping(self.standard_errors)
        for name, entry in values.items():
            lines.append(
                f"{name} = {entry['value']:.4g} +- {entry['standard_error']:.2g} "
                f"{entry['unit']}"
            )
        lines.append(
            f"mean error {100 * self.error_before:.2f} % before, "
            f"{100 * self.error_after:.2f} % refined"
        )
        notes = [*self.kept, *self.warnings]
        if self.refused or self.doubt:
            notes.append(self.refused or self.doubt)
        lines.extend(f"note: {note}" for note in notes)
        return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A refit, and what it is judged by.

    Attributes:
        samples: all of them.
        belongs: which of them the refit was fitted to, shape (n,).
        served: the model in service.
        base: the model against which drift is measured.
        model: the refit.
        others: for each fold, the refit to the samples outside it.
        held_back: the comparison on samples held out, if any.
        max_drift: largest mean change against `base` [-].
        max_change: largest change that needs no person [-].
        accepted: the model that a person accepted last.
    """

    samples: BenchSamples
    belongs: NDArray[np.bool_]
    served: EfficiencyModel
    base: EfficiencyModel
    model: EfficiencyModel
    others: list[EfficiencyModel]
    held_back: CrossValidation | None
    max_drift: float
    max_change: float
    accepted: EfficiencyModel

    @cached_property
    def domain(self) -> Domain:
        """The smallest box that holds the samples and the domain of the model in service."""
        box = Domain.of(self.samples.select(self.belongs))
        return box if self.served.domain is None else box.united(self.served.domain)

    @cached_property
    def grid(self) -> OperatingPoints:
        """Operating points over the domain."""
        axes = []
        for axis, number in zip(AXES, _GRID, strict=True):
            low, high = getattr(self.domain, axis)
            axes.append(np.linspace(low, high, number))
        mesh = np.meshgrid(*axes, indexing="ij")
        return OperatingPoints(*(axis.ravel() for axis in mesh))

    @cached_property
    def _refitted(self) -> Array:
        return carried_at(self.model, self.grid)

    @cached_property
    def change(self) -> Array:
        """Of the efficiency against the model in service, over the grid [-]."""
        return self._refitted - carried_at(self.served, self.grid)

    @cached_property
    def change_since_accepted(self) -> Array:
        """Of the efficiency against the model that a person accepted last, over the grid [-]."""
        if not self.accepted.states_errors:
            return np.zeros_like(self.change)
        return self._refitted - carried_at(self.accepted, self.grid)

    @cached_property
    def drift(self) -> float:
        """Mean change of the efficiency against the base model over the grid [-]."""
        return float(np.abs(self._refitted - carried_at(self.base, self.grid)).mean())

    @property
    def drift_limit(self) -> float:
        """Largest drift allowed; a base that does not state its errors is no measure [-]."""
        return self.max_drift if self.base.standard_errors else np.inf

    @property
    def largest_departure(self) -> float:
        """Largest change against the model in service and the one accepted last [-]."""
        changes = (self.change, self.change_since_accepted)
        return max(float(np.abs(change).max()) for change in changes)

    @property
    def rejected(self) -> NDArray[np.intp]:
        """Rejected samples, from 0."""
        return np.flatnonzero(~self.belongs)


def refit(
    samples: BenchSamples,
    served: EfficiencyModel,
    base: EfficiencyModel,
    *,
    seed: int = 0,
    max_drift: float = MAX_DRIFT,
    accepted: EfficiencyModel | None = None,
    max_change: float = MAX_CHANGE,
) -> Refit:
    """Fit the model in service to samples.

    Args:
        samples: of the bench; samples at one operating point count as one.
        served: the model in service: stage, formulation, effects and prior.
        base: model against which drift is measured, the one that the first refit began with.
        seed: of the random numbers.
        max_drift: largest mean change of the efficiency against `base` within the domain [-]; not
            for a base that does not state its errors.
        accepted: the model that a person accepted last, from which `max_change` counts too; the
            base when left out.
        max_change: largest change of an efficiency within the domain that needs no person [-]; not
            for a model in service that does not state its errors.

    Raises:
        InputError: as of `stage_of_each`.
        IdentificationError: fewer operating points than parameters, or no answer at the samples.
    """
    require_model(served, "served")
    require_model(base, "base")
    require_samples(samples)
    stage_of_each(served.stages, samples)  # raises where a sample names no known stage
    require_seed(seed)
    problem = RobustProblem(served, samples)
    _require_points(problem)
    fit, belongs = problem.consensus(seed)
    used = replace(problem, samples=samples.select(belongs))
    if not np.isfinite(used.predict(fit)).all():
        raise IdentificationError(
            f"{samples.source}: no parameters within the bounds give an efficiency at most of the "
            "samples: check stage, units and load torque"
        )
    update = Update.of(used, fit)
    fold = folds(used.samples, seed)
    others = _refits_without_each_fold(used, fold, update)
    all_folds = np.full(len(samples), -1)
    all_folds[belongs] = fold
    model = with_misfit(update.applied(used), samples, belongs, all_folds, others)
    held_back = None
    if others:
        held_back = cross_validate(used.samples, model, served, fold, others)
    candidate = _Candidate(
        samples=samples,
        belongs=belongs,
        served=served,
        base=base,
        model=model,
        others=others,
        held_back=held_back,
        max_drift=max_drift,
        max_change=max_change,
        accepted=accepted or base,
    )
    error_before = _error(served, samples)
    error_after = _error(model, samples)
    provenance = {
        **_kept_provenance(model),
        **origin("refit", samples, seed),
        "set_aside": len(candidate.rejected),
        "fit_error": float(f"{error_after:.6g}"),
    }
    return Refit(
        model=replace(model, domain=candidate.domain, provenance=provenance),
        set_aside=tuple((candidate.rejected + 1).tolist()),
        kept=update.kept(problem.prior),
        refused=_first_objection(candidate, _CHECKS),
        doubt=_doubt(candidate),
        largest_change=float(np.abs(candidate.change).max()),
        drift=candidate.drift,
        warnings=tuple(_warnings(candidate, used.samples, problem.predict(fit))),
        held_back=held_back,
        error_before=error_before,
        error_after=error_after,
        seed=seed,
    )


def _require_points(problem: RobustProblem) -> None:
    points = len(np.unique(problem.point_numbers))
    needed = len(PARAMETER_NAMES)
    if points < needed:
        plural = "s" if points > 1 else ""
        raise IdentificationError(
            f"{problem.samples.source}: {len(problem.samples)} samples at {points} distinct "
            f"working point{plural} cannot determine {needed} parameters; a refit needs at "
            f"least {needed} points"
        )


def _refits_without_each_fold(
    used: RobustProblem, fold: NDArray[np.intp], update: Update
) -> list[EfficiencyModel]:
    """Return the refits with the directions and fractions of `update`, each without one fold."""
    refits = []
    for number in range(fold.max() + 1):
        rest = replace(used, samples=used.samples.select(fold != number))
        refits.append(update.applied(rest))
    return refits


def _error(model: EfficiencyModel, samples: BenchSamples) -> float:
    predicted = model.solution_at(samples.points).efficiency
    return mean_error(predicted, samples.efficiency)


def _kept_provenance(model: EfficiencyModel) -> dict[str, Any]:
    """What a refit does not change, such as the units that were measured, and the noise."""
    return {
        name: model.provenance[name]
        for name in ("units", "misfit_noise")
        if name in model.provenance
    }


# --- objections to a refit ------------------------------------------------------------------------


def _misses(model: EfficiencyModel, samples: BenchSamples) -> Array:
    """Predicted less measured efficiency, shape (n,) [-]."""
    return carried_at(model, samples.points) - samples.efficiency


def _no_majority(candidate: _Candidate) -> str | None:
    rejected = len(candidate.rejected)
    count = len(candidate.samples)
    if rejected <= MAX_SET_ASIDE * count:
        return None
    return (
        f"{rejected} of {count} samples disagree with the others, more than a third: none can "
        "be trusted"
    )


def _worse_on_unseen_samples(candidate: _Candidate) -> str | None:
    held_back = candidate.held_back
    if held_back is None or not held_back.worse:
        return None
    return (
        "the refit is worse on samples held out: mean error "
        f"{100 * held_back.error_refit:.2f} %, model in service "
        f"{100 * held_back.error_in_service:.2f} %"
    )


def _unsupported_change(candidate: _Candidate) -> str | None:
    """Object to a change that rests on a few samples, by a jackknife of groups."""
    # A model that does not state its errors is, once refuted, worth no more than the refit.
    if not candidate.others or not candidate.served.states_errors:
        return None
    grid = candidate.grid
    change = candidate.change
    refits = np.array([carried_at(other, grid) for other in candidate.others])
    doubt = _CERTAIN * np.sqrt((len(refits) - 1) * refits.var(axis=0))
    noticed = np.abs(change) > _NOTICED
    excess = np.where(noticed, doubt - np.abs(change), -np.inf)
    worst = int(excess.argmax())
    if excess[worst] <= 0.0:
        return None
    return (
        f"the refit would move the efficiency by {100 * change[worst]:+.1f} points "
        f"at displacement ratio {grid.displacement_ratio[worst]:.2f}, "
        f"{grid.engine_speed[worst]:.1f} rad/s, {grid.load_torque[worst]:.0f} N m, "
        f"where the samples held out allow a doubt of {100 * doubt[worst]:.1f} points"
    )


def _too_much_drift(candidate: _Candidate) -> str | None:
    if candidate.drift <= candidate.drift_limit:
        return None
    return (
        f"the refit would differ from the base model by {100 * candidate.drift:.1f} points "
        f"on average, more than the {100 * candidate.drift_limit:.3g} points allowed"
    )


def _large_change(candidate: _Candidate) -> str | None:
    # A model that does not state its errors is an example: it may be another unit.
    if not candidate.served.states_errors:
        return None
    largest = candidate.largest_departure
    if largest <= candidate.max_change:
        return None
    return (
        f"the refit would move the efficiency by up to {100 * largest:.1f} points, more than the "
        f"{100 * candidate.max_change:.3g} points that are adopted without a person"
    )


def _contradiction(candidate: _Candidate) -> str | None:
    """Object where rejected samples may be right and the majority wrong.

    A mistake of a bench leads anywhere, mostly far away. Two readings that wear could explain may
    be what is left of the unit among samples of another one.
    """
    if not candidate.served.states_errors:
        return None
    if candidate.belongs.all():
        return None
    rejected = candidate.samples.select(~candidate.belongs)
    misses = _misses(candidate.model, rejected)
    explained = int((np.abs(misses) <= MAX_CHANGE).sum())
    if explained < _FEW_CONTRADICTIONS:
        return None
    return (
        f"{explained} samples that disagree with the others do so by less than "
        f"{100 * MAX_CHANGE:.3g} points: they may be of this unit, and the others of another"
    )


def _two_states(candidate: _Candidate) -> str | None:
    """Object where some samples agree with the model in service rather than with the refit.

    The likelihood of a mixture of both is compared with that of the refit alone. Samples far from
    both change neither.
    """
    if not candidate.served.states_errors:
        return None
    samples = candidate.samples
    of_refit = _misses(candidate.model, samples) / samples.efficiency
    of_served = _misses(candidate.served, samples) / samples.efficiency
    scatter = MEDIAN_TO_DEVIATION * float(np.median(np.abs(of_refit)))
    refitted = np.exp(-0.5 * (of_refit / scatter) ** 2)
    served = np.exp(-0.5 * (of_served / scatter) ** 2)
    fraction = _FRACTIONS[:, None]
    mixture = np.log((1.0 - fraction) * refitted + fraction * served + _FAR_FROM_BOTH)
    gain = mixture.sum(axis=1) - np.log(refitted + _FAR_FROM_BOTH).sum()
    best = int(gain.argmax())
    if 2.0 * gain[best] < _CERTAIN_MIXTURE:
        return None
    return (
        f"about {100 * _FRACTIONS[best]:.0f} % of the samples agree with the model in service "
        "rather than with the refit: they may be of two states of the unit, or of two units"
    )


def _trend(candidate: _Candidate) -> str | None:
    """Object to readings that drift over the log: the refit is then of no moment of it."""
    used = candidate.samples.select(candidate.belongs)
    if not candidate.served.states_errors or len(used) <= _FEWEST_FOR_A_TREND:
        return None
    misses = -_misses(candidate.model, used)
    order = np.linspace(-0.5, 0.5, len(used))
    slope = float(order @ misses / (order @ order))
    scatter = float(np.std(misses - slope * order, ddof=2))
    error = scatter / float(np.sqrt(order @ order))
    if abs(slope) < _NOTICED or abs(slope) < _CERTAIN_TREND * error:
        return None
    return (
        f"the readings drift by {100 * slope:+.1f} points from the first sample to the last: "
        "the refit would be a mean over that time"
    )


def _more_scatter(candidate: _Candidate) -> str | None:
    """Object to samples that scatter more than those that the model in service was fitted to.

    Samples of two units look like this where the units differ too little to be distinguished one by
    one.
    """
    provenance = candidate.served.provenance
    count = provenance.get("samples")
    error = provenance.get("fit_error")
    if not isinstance(count, int) or not isinstance(error, float):
        return None
    samples = candidate.samples
    predicted = carried_at(candidate.model, samples.points)
    # What is further off is a mistake of the bench and no other state of the unit.
    explained = np.abs(predicted - samples.efficiency) <= MAX_CHANGE
    misses = relative_errors(predicted, samples.efficiency)[explained]
    free = len(misses) - len(PARAMETER_NAMES)
    if count < _FEWEST_FOR_NOISE or free < 1:
        return None
    from scipy.stats import f as fisher

    known = _MEAN_TO_DEVIATION * error
    scatter = float(np.sqrt((misses**2).sum() / free))
    # Two units of like share flatten the middle of the distribution rather than its ends.
    scatter = max(scatter, MEDIAN_TO_DEVIATION * float(np.median(misses)))
    ratio = float(fisher.isf(_FALSE_ALARM, free, count - len(PARAMETER_NAMES)))
    if not scatter > _BENCHES_DIFFER * known * np.sqrt(ratio):
        return None
    return (
        f"the samples scatter by {100 * scatter:.2g} %, those of the model in service did by "
        f"{100 * known:.2g} %: they may be of two states of the unit, or of another bench"
    )


_Check = Callable[[_Candidate], str | None]

_CHECKS: tuple[_Check, ...] = (
    _no_majority,
    _worse_on_unseen_samples,
    _unsupported_change,
    _too_much_drift,
)


_DOUBTS: tuple[_Check, ...] = (
    _large_change,
    _contradiction,
    _two_states,
    _trend,
    _more_scatter,
)


def _first_objection(candidate: _Candidate, checks: tuple[_Check, ...]) -> str:
    for check in checks:
        objection = check(candidate)
        if objection is not None:
            return objection
    return ""


def _doubt(candidate: _Candidate) -> str:
    """Return why a person has to decide; a negligible change needs none."""
    if candidate.largest_departure <= _NOTICED:
        return ""
    return _first_objection(candidate, _DOUBTS)


def _warnings(candidate: _Candidate, used: BenchSamples, expected: Array) -> list[str]:
    """Sentences on the rejected samples and on what is left open."""
    warnings = gear_train_remarks(candidate.served, candidate.samples)
    warnings += set_aside_remarks(candidate.samples, candidate.rejected, expected)
    if candidate.drift > _NEAR_LIMIT * candidate.drift_limit:
        warnings.append(
            f"the refit differs from the base model by {100 * candidate.drift:.1f} points on "
            f"average, the limit is {100 * candidate.drift_limit:.3g}"
        )
    warnings += undetermined(used, candidate.model)
    warnings += misfit_remarks(candidate.model)
    if candidate.held_back is None:
        warnings.append(
            f"fewer than {FEWEST} samples: none could be held out to check the refit"
        )
    return warnings
