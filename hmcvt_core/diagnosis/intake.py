# SPDX-License-Identifier: Apache-2.0
"""Which samples a diagnosis can use; copies, impossible points and slips are left out and named."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files.bench import BenchSamples
from ..model.model import EfficiencyModel
from .candidates import Bench
from .hypothesis import BASE_SIZE, REFUSED
from .observations import Observations, distinct_rows
from .outliers import outliers
from .replicates import replicate_groups

LEAST_SAMPLES = 5
_MOST_REFUSED = 0.25  # part of the samples that the model may be unable to carry
_NAMED = 3  # samples that a note names one by one


def admitted(
    model: EfficiencyModel, samples: BenchSamples, noise: float | None
) -> tuple[Bench, tuple[str, ...]]:
    """Return the bench to diagnose, and a note on every sample that is left out.

    Raises:
        InputError: what remains cannot carry a diagnosis, or the formulation is another.
    """
    rows = distinct_rows(samples)
    _check(model, samples.select(rows))
    notes = []
    if len(rows) < len(samples):
        notes.append(f"{len(samples) - len(rows)} of {len(samples)} rows copy another one in every "
                     "column and were left out")
    bench = Bench(model, Observations.of(samples.select(rows), noise))
    impossible = np.flatnonzero(bench.base.whitened[0] == REFUSED)
    if len(impossible) > _MOST_REFUSED * len(rows):
        raise InputError(
            f"{samples.source}: no parameters let the model carry the load at {len(impossible)} of "
            f"{len(rows)} samples (first: {_named(samples, rows[impossible[0]])}): check "
            "load_torque, which is output power / engine speed, and the stage")
    if len(impossible):
        notes.append(f"{len(impossible)} samples ask for a load that the model cannot carry and "
                     f"were left out: {listed_samples(samples, rows[impossible])}")
        bench, rows = _without(bench, rows, impossible)
    slips = outliers(bench.observed, bench.base.whitened)
    if len(slips):
        notes += [f"{_named(samples, i)}, efficiency {samples.efficiency[i]:.4g}, stands alone "
                  "against its neighbours and was left out: measure it again"
                  for i in rows[slips]]
        bench, rows = _without(bench, rows, slips)
    _check(model, bench.observed.samples)
    return bench, tuple(notes)


def _without(
    bench: Bench, rows: NDArray[np.intp], dropped: NDArray[np.intp]
) -> tuple[Bench, NDArray[np.intp]]:
    kept = np.setdiff1d(np.arange(len(rows)), dropped)
    return Bench(bench.model, bench.observed.select(kept)), rows[kept]


def _check(model: EfficiencyModel, samples: BenchSamples) -> None:
    if model.formulation != "power_balance":
        raise InputError(f"diagnosis needs formulation power_balance, not {model.formulation!r}")
    if len(samples) < LEAST_SAMPLES:
        raise InputError(f"{samples.source}: {len(samples)} samples (rows that differ) cannot tell "
                         f"a gap from the {BASE_SIZE} parameters that are refitted; at least "
                         f"{LEAST_SAMPLES} are needed")
    points = len(np.unique(replicate_groups(samples)))
    if points <= BASE_SIZE:
        raise InputError(f"{samples.source}: {points} distinct operating points cannot tell a gap "
                         f"from the {BASE_SIZE} parameters that are refitted")


def _named(samples: BenchSamples, i: int) -> str:
    return (f"sample {i + 1} (displacement ratio {samples.displacement_ratio[i]:.3g}, engine speed "
            f"{samples.engine_speed[i]:.4g} rad/s, load torque {samples.load_torque[i]:.4g} N m)")


def listed_samples(samples: BenchSamples, rows: NDArray[np.intp]) -> str:
    """Return the first few of some samples by number and operating point."""
    named = ", ".join(_named(samples, i) for i in rows[:_NAMED])
    return named + (" and others" if len(rows) > _NAMED else "")
