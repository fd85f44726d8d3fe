# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Checks that a model and samples are what public functions take them for."""

from typing import Any

from ..files.bench import BenchSamples
from ..files.checks import is_dataframe, is_path, wrong_type
from .model import EfficiencyModel


def require_model(value: Any, argument: str = "model") -> None:
    """Raise an `InputError` where an argument is not a model."""
    if isinstance(value, EfficiencyModel):
        return
    hint = ""
    if isinstance(value, BenchSamples):
        hint = "are model and samples swapped?"
    elif is_path(value):
        hint = "read it by load_model(path)"
    elif isinstance(getattr(value, "model", None), EfficiencyModel):
        hint = "take its attribute model"
    raise wrong_type(argument, "an EfficiencyModel", value, hint)


def require_samples(value: Any, argument: str = "samples") -> None:
    """Raise an `InputError` where an argument is not bench samples."""
    if isinstance(value, BenchSamples):
        return
    hint = "make them by BenchSamples(displacement_ratio, engine_speed, load_torque, efficiency)"
    if isinstance(value, EfficiencyModel):
        hint = "are model and samples swapped?"
    elif is_path(value):
        hint = "read them by read_bench(path)"
    elif is_dataframe(value):
        hint = "convert it by BenchSamples.from_dataframe(frame)"
    raise wrong_type(argument, "BenchSamples", value, hint)


def require_model_and_samples(
    model: Any, samples: Any, holdout: Any = None, other: str = "holdout"
) -> None:
    """Raise an `InputError` where a model or samples are something else.

    Args:
        model: to be an `EfficiencyModel`.
        samples: to be `BenchSamples`.
        holdout: to be `BenchSamples` or None.
        other: name of the argument `holdout`.
    """
    require_model(model)
    require_samples(samples)
    if holdout is not None:
        require_samples(holdout, other)
