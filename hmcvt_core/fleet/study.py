# SPDX-License-Identifier: Apache-2.0
"""One log: samples in, outcome out; no file is touched, so it can run anywhere."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

from ..benches.transmission import diagnose
from ..errors import HmcvtError
from ..files.bench import BenchSamples
from ..identification import identify
from ..model.model import EfficiencyModel
from .settings import Settings


class Task(NamedTuple):
    """A log to be studied."""

    name: str
    samples: BenchSamples


@dataclass(frozen=True, eq=False)
class Study:
    """Outcome of a log.

    Attributes:
        log_sha256: of the log that was studied.
        model: the identified model.
        identification: as `hmcvt identify --json` prints it.
        diagnosis: as `hmcvt diagnose --json` prints it for that model, or None.
    """

    log_sha256: str
    model: EfficiencyModel
    identification: dict[str, Any]
    diagnosis: dict[str, Any] | None


@dataclass(frozen=True)
class Broken:
    """A log without outcome, and why in one line."""

    reason: str


Outcome = Study | Broken
Outcomes = Generator[tuple[str, Outcome], None, None]
Execute = Callable[[Iterator[Task], Settings], Outcomes]
"""Studies tasks side by side; gives name and outcome of each in the order they finish.

Tasks are taken one by one as there is room, so that a fleet need not fit into memory.
"""


def study(samples: BenchSamples, settings: Settings) -> Outcome:
    """Identify the parameters of a log and diagnose its gap; equal input gives equal output."""
    try:
        return _study(samples, settings)
    except HmcvtError as error:
        return Broken(str(error))
    except Exception as error:  # one log must not stop thousands
        return Broken(internal_failure(error))


def internal_failure(error: BaseException) -> str:
    """Return an unexpected error as one line that tells the place."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" at {frames[-1].filename}:{frames[-1].lineno}" if frames else ""
    text = " ".join(str(error).split())
    return f"internal failure (please report it): {type(error).__name__}: {text}{place}"


def _study(samples: BenchSamples, settings: Settings) -> Study:
    tried = [identify(samples, stage=stage, formulation=settings.formulation,
                      effects=settings.effects, seed=settings.seed) for stage in settings.stages]
    found = min(tried, key=lambda item: item.objective)
    diagnosis = None
    if settings.diagnosed:
        diagnosis = diagnose(found.model, samples, noise=settings.noise,
                             seed=settings.seed).to_dict()
    gears = sorted({pair.efficiency for pair in found.model.stage.gear_pairs})
    identification = {**found.to_dict(), "gear_efficiency": gears}
    return Study(samples.sha256, found.model, identification, diagnosis)
