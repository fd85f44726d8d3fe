# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""One log: samples and settings in, outcome out; no file is touched, so it can run anywhere."""

from __future__ import annotations

import hashlib
import traceback
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from ..benches.transmission import Transmission, diagnose
from ..errors import HmcvtError
from ..files.bench import BenchSamples
from ..identification import identify
from ..model.model import EfficiencyModel
from ..physics.effects.base import Effect
from ..transmission.parameters import PAPER_PARAMETERS
from ..transmission.ranges import EFFICIENCY_STD
from ..transmission.stage import Stage
from ..version import __version__


@dataclass(frozen=True, eq=False)
class Settings:
    """Settings of `identify` and `diagnose`, the same for every log.

    Attributes:
        stages: gear trains to compare; the one with the lowest objective is kept.
        formulation: `power_balance` or `published`.
        effects: effects with fixed parameters that act besides.
        diagnosed: whether the gap is diagnosed too.
        noise: standard deviation of the efficiency [-]; None for what the log states.
        seed: of every random number.

    Raises:
        InputError: a setting is out of range, or two do not go together.
    """

    stages: tuple[Stage, ...]
    formulation: str = "power_balance"
    effects: tuple[Effect, ...] = ()
    diagnosed: bool = True
    noise: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        # Told once, before the work, not by every log.
        for stage in self.stages:
            model = EfficiencyModel(stage, PAPER_PARAMETERS[0.98], self.formulation, self.effects)
            if self.diagnosed:
                Transmission(model)
        if self.noise is not None:
            EFFICIENCY_STD.check(self.noise, "noise")

    @cached_property
    def sha256(self) -> str:
        """Changes with every setting and with the version of hmcvt."""
        return hashlib.sha256(f"{__version__} {self!r}".encode()).hexdigest()


class Task(NamedTuple):
    """A log to be studied."""

    name: str
    samples: BenchSamples


@dataclass(frozen=True, eq=False)
class Study:
    """Outcome of a log.

    Attributes:
        model: the identified model.
        identification: as `hmcvt identify --json` prints it.
        diagnosis: as `hmcvt diagnose --json` prints it for that model, or None.
    """

    model: EfficiencyModel
    identification: dict[str, Any]
    diagnosis: dict[str, Any] | None


Outcome = Study | str
"""Of a log; the text says in one line why there is none."""


def study(samples: BenchSamples, settings: Settings) -> Outcome:
    """Identify the parameters of a log and diagnose its gap; equal input gives equal output."""
    try:
        tried = [identify(samples, stage=stage, formulation=settings.formulation,
                          effects=settings.effects, seed=settings.seed)
                 for stage in settings.stages]
        found = min(tried, key=lambda item: item.objective)
        diagnosis = None if not settings.diagnosed else diagnose(
            found.model, samples, noise=settings.noise, seed=settings.seed).to_dict()
        return Study(found.model, found.to_dict(), diagnosis)
    except HmcvtError as error:
        return str(error)
    except Exception as error:  # one log must not stop thousands
        return internal_failure(error)


def internal_failure(error: BaseException) -> str:
    """Return an unexpected error as one line that tells the place."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" at {frames[-1].filename}:{frames[-1].lineno}" if frames else ""
    text = " ".join(str(error).split())
    return f"internal failure (please report it): {type(error).__name__}: {text}{place}"
