# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnosis of one pump or motor: its gap to the loss terms of the paper, in flow and torque."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...diagnosis import Diagnosis, diagnose_system, next_test
from ...diagnosis.observations import Observations
from ...diagnosis.results.outcome import NAMING
from ...diagnosis.system import Channel
from ...errors import InputError
from ...files import preformatted
from ...files.checks import one_holdout, require_seed
from ..baseline import leading_effects, refuse_contradicted
from .change import UnitChange, diagnose_change
from .samples import MIN_TORQUE_PRESSURE, UnitSamples
from .served import ServedUnit, paper_terms, served_unit
from .system import (
    FRICTION,
    LARGEST_GAIN,
    METER_GAIN,
    PARAMETERS,
    STROKE,
    HydrostaticUnit,
    UnitModel,
    observe_unit,
)

DEALS = 8
"""Parts of the samples; each is left out once to test whether the same set of causes leads."""
STEADY = 0.75
"""Fraction of the folds that must lead to the same set; chosen on simulated units."""
REFERENCE_DISPLACEMENT = "reference_displacement"
"""Effect: the displacement stated in the table is not that of the unit."""
FEWEST_AT_HIGH_PRESSURE = 3
"""Samples with the smallest mechanical loss whose mean is compared with the paper's friction."""
HIGH_PRESSURE = 0.5
"""Fraction of the largest pressure above which friction makes up most of the torque loss."""


@dataclass(frozen=True, eq=False)
class UnitDiagnosis:
    """A diagnosis of a unit, and its errors in both channels.

    Attributes:
        diagnosis: as of any system; the gap is that of the flow loss.
        paper: the terms of the paper alone, refitted, the meters taken as exact.
        model: with the leading set of effects, whether the verdict names it or not.
        served: the saved model; None where there is no gap.
        leading: names of the effects of `model`.
        holdout: held-out samples, or None.
        same: in how many of the fold assignments the same set leads; None where no cause is named.
        seed: of every random number.
    """

    diagnosis: Diagnosis
    paper: UnitModel
    model: UnitModel
    holdout: UnitSamples | None
    same: int | None
    seed: int = 0
    served: ServedUnit | None = None
    leading: tuple[str, ...] = ()

    @property
    def found(self) -> Diagnosis:
        """Earlier name of `diagnosis`."""
        return self.diagnosis

    @property
    def rmse(self) -> dict[str, dict[str, float | None]]:
        """Errors by channel, m3/s and N m; None without a holdout.

        `base` is the terms of the paper, `with_effects` the saved model.
        """
        models = {"base": self.paper, "with_effects": self.served or self.model}
        errors: dict[str, dict[str, float | None]] = {"flow": {}, "torque": {}}
        for prefix, samples in (
            ("", self.diagnosis.samples),
            ("holdout_", self.holdout),
        ):
            for name, model in models.items():
                flow, torque = (None, None) if samples is None else model.rmse(samples)
                errors["flow"][prefix + name] = flow
                errors["torque"][prefix + name] = torque
        return errors

    @property
    def errors(self) -> tuple[float, float]:
        """Standard errors: of log10 of the leakage [-], and of the damping [N m s/rad]."""
        system = self.model.system
        decades, damping, *_ = np.sqrt(self._variances)
        return float(decades), float(damping) * system.size

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard errors of leakage, damping and friction, linearised, each in its unit."""
        decades, damping = self.errors
        friction_decades = float(np.sqrt(self._variances[2]))
        return {
            "leakage": np.log(10.0) * decades * self.model.parameters["leakage"],
            "damping": damping,
            "friction": np.log(10.0) * friction_decades * self.model.friction,
        }

    @property
    def _variances(self) -> Any:
        """Variances of the scaled base parameters with the leading set, else of the prior."""
        for explanation, _ in self.diagnosis.posterior.entries:
            if explanation.names == self.leading:
                return np.diag(explanation.plain_model.covariance)
        return self.model.system.base.spread**2

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object of `hmcvt unit --json`."""
        data = self.diagnosis.to_dict()
        stroke = self.diagnosis.samples.displacement_ratio
        for region in data["where"]:
            region.setdefault(STROKE.name, [float(stroke.min()), float(stroke.max())])
        errors = self.standard_errors
        parameters = {
            name: {
                "value": value,
                "unit": PARAMETERS[name],
                "standard_error": errors[name],
            }
            for name, value in self.model.parameters.items()
        }
        parameters["friction"] = {
            "value": self.model.friction,
            "unit": "-",
            "standard_error": errors["friction"],
        }
        return {
            **data,
            "rmse": self.rmse,
            "same_set_in_deals": self.same,
            "served": [] if self.served is None else self.served.to_dict(),
            "parameters": parameters,
        }

    def report(self) -> str:
        """Return the outcome as text for a person."""
        lines = [self.diagnosis.report()]
        if self.same is not None:
            lines.append(f"deals      the same set leads in {self.same} of {DEALS}")
        rmse = self.rmse
        for channel in self.model.system.channels:
            name = channel.name.removesuffix("_loss")
            row = rmse[name]
            lines.append(f"{name:10} {_errors_in_words(row, channel)}")
        errors = self.standard_errors
        for name, value in self.model.parameters.items():
            lines.append(
                f"{name:10} {value:.4g} +- {errors[name]:.2g} {PARAMETERS[name]}"
            )
        lines.append(
            f"friction   {self.model.friction:.4g} +- {errors['friction']:.2g} of the "
            "pressure torque"
        )
        return "\n".join(lines)

    def plot(self, ax: Any = None) -> Any:
        """Return a matplotlib picture of the residuals; see `Diagnosis.plot`."""
        return self.diagnosis.plot(ax)

    def _repr_html_(self) -> str:
        return preformatted(self.report())


def _errors_in_words(row: dict[str, float | None], channel: Channel) -> str:
    """Return the errors of a channel in the unit of its reports."""
    errors = {
        name: f"{channel.factor * value:.3g}"
        for name, value in row.items()
        if value is not None
    }
    text = (
        f"rms left by the paper's terms -> saved model, {channel.unit}: "
        f"fitted {errors['base']} -> {errors['with_effects']}"
    )
    if "holdout_base" in errors:
        text += (
            f", held out {errors['holdout_base']} -> {errors['holdout_with_effects']}"
        )
    return text


def diagnose_unit(
    samples: UnitSamples,
    holdout: UnitSamples | None = None,
    *,
    deals: bool = True,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    validation: UnitSamples | None = None,
    baseline: UnitSamples | None = None,
) -> UnitDiagnosis | UnitChange:
    """Diagnose the gap between the loss terms of the paper and a unit, or a change of it.

    A set of causes is named only where it leads in three quarters of the fold assignments too.
    While the displacement stated is in doubt, no other cause is named.

    Args:
        samples: at least five.
        holdout: of the same unit, such as a band of pressure.
        deals: whether to repeat the search without each part of the samples (fold assignments).
        seed: of every random number.
        progress: as of `diagnose_system`.
        validation: former name of `holdout`.
        baseline: the same unit when it was sound, which is held: then only what has changed since
            is diagnosed, and the result is a `UnitChange`.

    Raises:
        InputError: as `diagnose_system` and `diagnose_change`, or the holdout is of another unit.
    """
    holdout = one_holdout(holdout, validation)
    require_seed(seed)
    if baseline is not None:
        return diagnose_change(samples, baseline, holdout, seed=seed, progress=progress)
    doubt = _displacement_doubt(samples)
    if holdout is not None:
        _check_holdout(holdout, samples)
        doubt = doubt or _displacement_doubt(holdout)
        holdout, _ = _with_torque(holdout)
    samples, notes = _with_torque(samples)
    if samples.flow_loss is None:
        raise InputError(
            f"{samples.source}: no flow is read; a drain flow alone is compared with a "
            "baseline only"
        )
    system = HydrostaticUnit(samples)
    observed = observe_unit(system, samples)
    diagnosis = diagnose_system(
        system,
        observed,
        None if holdout is None else observe_unit(system, holdout),
        notes=[*samples.notes, *notes],
        seed=seed,
        progress=progress,
    )
    model: UnitModel = diagnosis.base
    same = None
    leading: tuple[str, ...] = ()
    if diagnosis.causes:
        model = diagnosis.causes[0].model
        leading = diagnosis.sets[0].effects
        if diagnosis.verdict in NAMING and deals:
            twins = diagnosis.twins_of(leading)
            same = _folds_led_by(twins, system, observed, seed, progress)
        diagnosis = replace(diagnosis, verdict=_verdict(diagnosis, same, doubt))
        if doubt is None and REFERENCE_DISPLACEMENT in leading:
            doubt = _displacement_error(model)
    diagnosis, served = _handed_over(diagnosis, system, samples, progress)
    return UnitDiagnosis(
        _with_doubt(diagnosis, doubt),
        paper_terms(system, samples),
        model,
        holdout,
        same,
        seed,
        served,
        leading,
    )


def _handed_over(
    diagnosis: Diagnosis,
    system: HydrostaticUnit,
    samples: UnitSamples,
    progress: Callable[[str], None] | None,
) -> tuple[Diagnosis, ServedUnit | None]:
    """Return a diagnosis without contradicted sets, and the saved model.

    Args:
        diagnosis: of the unit.
        system: the unit.
        samples: to which models are fitted.
        progress: as of `diagnose_system`.
    """
    if diagnosis.verdict == "no_gap":
        return diagnosis, None
    if progress is not None:
        progress("the saved model")
    served = served_unit(system, samples, leading_effects(diagnosis))
    diagnosis = refuse_contradicted(diagnosis)
    notes = (*diagnosis.notes, *served.notes())
    return replace(diagnosis, notes=notes), served


def _check_holdout(holdout: UnitSamples, samples: UnitSamples) -> None:
    if (holdout.kind, holdout.displacement) != (samples.kind, samples.displacement):
        raise InputError(
            f"{holdout.source}: a {holdout.kind} of {holdout.displacement:.4g} m3/rad "
            f"is not the unit of {samples.source}"
        )
    if samples.oil_temperature is not None and holdout.oil_temperature is None:
        raise InputError(
            f"{holdout.source}: column oil_temperature is missing; {samples.source} "
            "has it"
        )


def _with_torque(samples: UnitSamples) -> tuple[UnitSamples, list[str]]:
    """Leave out samples at pressures too low for a mechanical efficiency to give a torque."""
    if samples.torque_loss is None:
        return samples, []
    enough = samples.pressure >= MIN_TORQUE_PRESSURE
    low = int(np.sum(~enough))
    notes = []
    if low:
        notes.append(
            f"{low} samples below {MIN_TORQUE_PRESSURE:g} Pa give no torque and were left out"
        )
    return samples.select(enough), notes


def _verdict(diagnosis: Diagnosis, same: int | None, doubt: str | None) -> str:
    """Verdict of a diagnosis with causes, weakened where folds or displacement contradict it."""
    verdict = diagnosis.verdict
    if same is not None and same < STEADY * DEALS:
        verdict = "ambiguous"
    leading = diagnosis.sets[0].effects
    if doubt and verdict in NAMING and leading != (REFERENCE_DISPLACEMENT,):
        verdict = "unexplained"
    return verdict


def _displacement_error(model: UnitModel) -> str:
    """Return a clause on how much the losses contradict the displacement stated."""
    effects = {effect.name: effect for effect in model.effects}
    excess = effects[REFERENCE_DISPLACEMENT].values()["excess"]
    return f"the displacement stated is {100.0 * excess:+.1f} % off by the losses"


def _with_doubt(diagnosis: Diagnosis, doubt: str | None) -> Diagnosis:
    """Put a doubt about the displacement before the notes.

    Notes on option --noise are dropped: for a unit it states the noise of both meters.
    """
    notes = tuple(note for note in diagnosis.notes if "--noise" not in note)
    if doubt is None:
        return replace(diagnosis, notes=notes, warnings=())
    return replace(diagnosis, notes=(doubt, *notes), warnings=(doubt,))


def _folds_led_by(
    sets: Collection[tuple[str, ...]],
    system: HydrostaticUnit,
    observed: Observations,
    seed: int,
    progress: Callable[[str], None] | None,
) -> int:
    """Count the fold assignments, each without one part of the samples, in which a set leads."""
    order = np.random.default_rng(seed).permutation(len(observed))
    count = 0
    for i, part in enumerate(np.array_split(order, DEALS), 1):
        if progress is not None:
            progress(f"deal {i} of {DEALS}")
        kept = observed.without(part)
        one_test = {name: row[:1] for name, row in kept.points.items()}
        try:
            advice = next_test(system, kept, one_test)
        except InputError:  # too few samples remain for a diagnosis
            continue
        listed = [names for names, _ in advice.candidates if names]
        if listed and listed[0] in sets:
            count += 1
    return count


def _displacement_doubt(samples: UnitSamples) -> str | None:
    """Return a clause where less torque is lost than the paper's friction alone takes, or None.

    A displacement stated too large makes it so; errors of a class A torque meter are allowed for.
    """
    if samples.torque_loss is None:
        return None
    high = samples.select(samples.pressure > HIGH_PRESSURE * samples.pressure.max())
    _, ideal_torque = high.ideal
    lost = np.sort(np.asarray(high.torque_loss) / ideal_torque)[
        :FEWEST_AT_HIGH_PRESSURE
    ]
    if lost.mean() >= FRICTION - LARGEST_GAIN * METER_GAIN:
        return None
    return (
        f"a mechanical loss of {100.0 * lost[0]:.1f} % at high pressure is less than friction "
        f"alone takes, {100.0 * FRICTION:g} %: the displacement stated is in doubt"
    )
