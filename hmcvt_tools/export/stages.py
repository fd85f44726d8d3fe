# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Some of the stages of a model."""

from collections.abc import Collection
from dataclasses import replace

from hmcvt_core.model.model import EfficiencyModel


def with_stages(model: EfficiencyModel, names: Collection[str]) -> EfficiencyModel:
    """Return a model of some stages, in the order of the model.

    Raises:
        InputError: the model has no such stage.
    """
    for name in names:
        model.in_stage(name)
    kept = []
    for name, part in model.stages.items():
        if name in names:
            kept.append(part.stage)
    return replace(model, stage=kept[0], other_stages=tuple(kept[1:]))
