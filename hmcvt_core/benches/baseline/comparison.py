# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A campaign compared with a sound machine: what all benches have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any

from ...diagnosis import Diagnosis, diagnose_system
from ...diagnosis.observations import Observations
from .change import (
    CLASS_TO_DRIFT,
    Change,
    SoundMachine,
    different_curves,
    with_sound_uncertainty,
)
from .control import Control, excess_of, judge_control
from .record import Baseline


@dataclass(frozen=True)
class Reference:
    """A sound machine that is held, and where it comes from.

    Attributes:
        machine: fitted to the sound samples without the control.
        samples: number of sound samples, the control among them.
        control: outcome of the control.
        untestable: effects that need an axis along which the tests do not vary.
        notes: on the comparison.
    """

    machine: SoundMachine
    samples: int
    control: Control
    untestable: tuple[Any, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ChangeDiagnosis(Diagnosis):
    """Diagnosis of a change; the sound machine stands for the base model.

    Attributes:
        baseline: where the sound machine comes from, and its control.
    """

    baseline: Baseline = field(kw_only=True)

    @classmethod
    def of(cls, diagnosis: Diagnosis, baseline: Baseline) -> ChangeDiagnosis:
        """Return a diagnosis with its baseline."""
        values: dict[str, Any] = {}
        for item in fields(diagnosis):
            values[item.name] = getattr(diagnosis, item.name)
        return cls(**values, baseline=baseline)

    @property
    def component(self) -> str | None:
        """The part that has changed, where one holds most of the probability."""
        return self.baseline.component(self)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object of `hmcvt diagnose --baseline --json`."""
        return {**super().to_dict(), "baseline": self.baseline.to_dict(self)}

    def report(self) -> str:
        """Return the outcome as text for a person."""
        return f"{super().report()}\n{self.baseline.line()}"


def compare(
    reference: Reference,
    observed: Observations,
    held_out: Observations | None,
    *,
    seed: int,
    progress: Callable[[str], None] | None,
) -> tuple[Diagnosis, Baseline]:
    """Diagnose the difference between a campaign and a sound machine.

    Args:
        reference: the sound machine.
        observed: the campaign, with the noise that the machine states.
        held_out: further samples of it, or None.
        seed: of every random number.
        progress: as of `diagnose_system`.

    Returns:
        The diagnosis with one effect of each curve, and the baseline, whose `applied_to` shares
        the probability among effects that are the same curve.
    """
    machine = reference.machine
    with_sound = with_sound_uncertainty(observed, machine)
    curves = different_curves(machine, with_sound)
    library = tuple(effect for effect in machine.library if effect.name in curves)
    # A difference that another meter of the same class explains is no change.
    differs = judge_control(machine, observed, seed).alarms
    meters = 1.0 if differs else CLASS_TO_DRIFT
    if held_out is not None:
        held_out = with_sound_uncertainty(held_out, machine)
    diagnosis = diagnose_system(
        Change(machine, library, meters),
        with_sound,
        held_out,
        seed=seed,
        progress=progress,
    )
    same_curves = {}
    for name, group in curves.items():
        if len(group) > 1:
            same_curves[name] = group
    baseline = Baseline(
        source=machine.source,
        samples=reference.samples,
        control=reference.control,
        same_curves=same_curves,
        excess=excess_of(machine, observed, seed),
        machine=machine,
        untestable=reference.untestable,
        notes=reference.notes,
    )
    return diagnosis, baseline
