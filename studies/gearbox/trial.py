# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""One machine of the type, sound and a year later, and what the diagnosis answers.

A module of its own: processes of a pool do not import what belongs to `__main__`.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.diagnosis.results.outcome import NAMING
from hmcvt_core.model.parameter_file import load_stages
from studies.gearbox import box, tables

GROWTH = 0.6
"""Of the leakage of a worn machine."""
LEAKING = ("laminar_leakage",)
"""Set that names the wear."""
NOISE = 0.0025
SPREAD = 0.15
"""Standard deviation of the logarithm of leakage and dampings from machine to machine."""
YEAR = 1_000_000
"""Added to the seed of the sound campaign for that a year later."""


@dataclass(frozen=True)
class Case:
    """One machine and its two campaigns.

    Attributes:
        worn: whether it leaks more a year later.
        tests: in each stage.
        zero: deviation of the zeros of the meters / their class [-].
        seed: of machine and campaigns.
    """

    worn: bool
    tests: int
    zero: float
    seed: int


@dataclass(frozen=True)
class Answer:
    """What a diagnosis with a baseline says of a case.

    Attributes:
        case: that was diagnosed.
        verdict: of the diagnosis.
        thin: whether the baseline is called too thin.
        first: effects of the leading set.
        probabilities: of each effect, that it is present.
        growth: of the leakage and its interval, None where it is not stated [-].
        component: part that is named, or None.
    """

    case: Case
    verdict: str
    thin: bool
    first: tuple[str, ...]
    probabilities: Mapping[str, float]
    growth: tuple[float, float, float] | None
    component: str | None

    @property
    def alarm(self) -> bool:
        """Whether a change is reported."""
        return self.verdict != "no_gap"

    @property
    def quiet_unsaid(self) -> bool:
        """Whether no change is reported, nor that the baseline is too thin."""
        return not self.alarm and not self.thin

    @property
    def named(self) -> bool:
        """Whether the verdict names a cause and more leakage alone leads."""
        return self.verdict in NAMING and self.first == LEAKING

    @property
    def in_pump(self) -> bool:
        """Whether the part is named that holds the wear."""
        return self.component == "pump"

    @property
    def holds(self) -> bool:
        """Whether more leakage alone leads and the interval of its growth holds the true one."""
        if self.growth is None or not self.named:
            return False
        _, low, high = self.growth
        return low <= GROWTH <= high

    @property
    def absent_named(self) -> bool:
        """Whether something absent is in the leading set of a verdict, or more likely than not."""
        if self.verdict not in NAMING:
            return False
        likely = {name for name, value in self.probabilities.items() if value > 0.5}
        present = LEAKING if self.case.worn else ()
        return bool((likely | set(self.first)) - set(present))

    def to_line(self) -> str:
        """Return the answer as a line of JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_line(cls, line: str) -> Answer:
        """Return the answer of a line of JSON."""
        values = json.loads(line)
        case = Case(**values.pop("case"))
        first = tuple(values.pop("first"))
        growth = values.pop("growth")
        return cls(case, first=first, growth=growth and tuple(growth), **values)


def machine(seed: int) -> box.Machine:
    """Return a machine of the type."""
    random = np.random.default_rng(seed)
    leakage, motor, pump = np.exp(SPREAD * random.standard_normal(3))
    typical = box.Machine()
    return box.Machine(
        leakage * typical.leakage,
        motor * typical.motor_damping,
        pump * typical.pump_damping,
        box.TYPICAL_DRAG,
    )


def answered(case: Case) -> Answer:
    """Return the answer of the diagnosis to a case."""
    sound = machine(case.seed)
    later = sound
    if case.worn:
        later = replace(sound, leakage=(1.0 + GROWTH) * sound.leakage)
    first = box.campaign(sound, case.tests, case.seed, case.zero)
    second = box.campaign(later, case.tests, YEAR + case.seed, case.zero, year=2027)
    baseline = tables.samples(first, "sound")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "box.yaml"
        path.write_text(tables.transmission_text(), encoding="utf-8")
        stages = list(load_stages(path))
    fit = hmcvt.identify(baseline, stage=stages, noise=NOISE)
    diagnosis = hmcvt.diagnose(
        fit.model, tables.samples(second, "later"), baseline=baseline, noise=NOISE
    )
    leading = diagnosis.sets[0].effects if diagnosis.sets else ()
    probabilities = {}
    for cause in diagnosis.causes:
        probabilities[cause.effect] = round(cause.probability, 4)
    record = diagnosis.baseline
    growth = record.growth(diagnosis) if diagnosis.verdict != "no_gap" else None
    return Answer(
        case=case,
        verdict=diagnosis.verdict,
        thin=record.excess.is_thin,
        first=leading,
        probabilities=probabilities,
        growth=(growth.part, *growth.interval) if growth else None,
        component=diagnosis.component,
    )
