# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The stage in which each bench sample was taken."""

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files.bench import BenchSamples
from .model import EfficiencyModel


def stage_of_each(
    stages: Collection[str], samples: BenchSamples
) -> NDArray[np.str_] | None:
    """Return the stage of each sample, shape (n,); None where one stage needs no column.

    Raises:
        InputError: of several stages a sample names none, or one that the model does not have.
    """
    names = samples.points.stage
    if names is None:
        if len(stages) > 1:
            raise InputError(
                f"{samples.source}: column stage is missing; the model has "
                f"{', '.join(stages)}: add it to the bench file (`hmcvt import --stage "
                "COLUMN` takes it from a table)"
            )
        return None
    unknown = np.flatnonzero(~np.isin(names, list(stages)))
    if len(unknown):
        first = int(unknown[0])
        raise InputError(
            f"{samples.source}: {samples.label(first)}: stage {str(names[first])!r} is "
            f"not known to the model; there is {', '.join(stages)}: give a transmission or "
            "parameter file that has it"
        )
    return np.asarray(names)


def rows_by_stage(
    model: EfficiencyModel, samples: BenchSamples
) -> dict[str, NDArray[np.bool_]]:
    """Return which samples are of each stage that occurs; errors as of `stage_of_each`."""
    names = stage_of_each(model.stages, samples)
    if names is None:
        return {model.stage.name: np.ones(len(samples), dtype=bool)}
    return {name: names == name for name in dict.fromkeys(names.tolist())}


def by_stage(model: EfficiencyModel, samples: BenchSamples) -> dict[str, BenchSamples]:
    """Return the samples of each stage that occurs; errors as of `stage_of_each`."""
    return {
        name: samples if rows.all() else samples.select(rows)
        for name, rows in rows_by_stage(model, samples).items()
    }
