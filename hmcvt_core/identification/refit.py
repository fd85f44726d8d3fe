# SPDX-License-Identifier: Apache-2.0
"""A refit of the model in service that can do no harm: what the samples do not say, it keeps.

1. Which samples belong together: least trimmed squares find the parameters that the better half of
   the samples agrees on; the scatter about them tells which others do not belong, and those are set
   aside [Rousseeuw & Leroy 1987, Robust Regression and Outlier Detection, ch. 5]. Samples at one
   working point have one vote together.
2. What they say: the information of the others, measured in the width of what was known before (the
   covariance of the model in service, and the wear that hydraulics may have: `PRIOR_SPREAD`), falls
   into three independent directions. In each the change has a significance t, the least that is
   left when any one sample is taken away.
3. What is followed: the prior is the model in service; its variance in each direction is the
   smallest under which the change lies within `_SIGNIFICANT` standard deviations (covariance
   inflation of an adaptive Kalman filter [Jazwinski 1969, Automatica 5]). That follows 1 - c2/t2 of
   a change: wear is followed though the prior be tight, noise is not though it be wide.
4. Whether that may serve: `Refit.refused` says what speaks against it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import IdentificationError
from ..files.bench import BenchSamples
from ..model.agreement import RelativeError, output_speed_remark, predicted_at
from ..model.domain import AXES, Domain
from ..model.model import EfficiencyModel
from ..transmission.parameters import (
    PARAMETER_NAMES,
    PRIOR_MEAN,
    PRIOR_SPREAD,
    SEARCH_BOUNDS,
    HydraulicParameters,
    from_scaled,
    to_scaled,
)
from ..transmission.ranges import OperatingPoints
from ..version import __version__
from . import annealing
from .cross_validation import FEWEST, QUICK, CrossValidation, cross_validate, folds
from .problem import Problem

Array = NDArray[np.float64]
MAX_DRIFT = 0.10


@dataclass(frozen=True, eq=False)
class Refit:
    """A model fitted to samples with the one in service as prior, and whether it may serve.

    Attributes:
        model: the refit; what the samples do not determine is that of the model in service.
        set_aside: samples that disagree with the rest, from 1 in their order.
        kept: sentences on what was kept from the model in service.
        refused: one line, what speaks against adopting it; empty when nothing does.
        largest_change: of an efficiency within the domain, against the model in service [-].
        drift: the same against the base model [-].
        warnings: sentences on the samples set aside and on what is left open.
        held_back: the comparison on samples held back, None with fewer than four to compare.
        error_before, error_after: mean |predicted - measured| / measured of the model in service
            and of the refit, over all samples [-].
    """

    model: EfficiencyModel
    set_aside: tuple[int, ...]
    kept: tuple[str, ...]
    refused: str
    largest_change: float
    drift: float
    warnings: tuple[str, ...]
    held_back: CrossValidation | None
    error_before: float
    error_after: float


def refit(
    samples: BenchSamples,
    served: EfficiencyModel,
    base: EfficiencyModel,
    *,
    seed: int = 0,
    max_drift: float = MAX_DRIFT,
) -> Refit:
    """Fit the model in service to samples.

    Args:
        samples: of the bench; samples at one working point count as one.
        served: the model in service: stage, formulation, effects and prior.
        base: model against which drift is measured, the one that the first refit began with.
        seed: of the random numbers.
        max_drift: largest change of an efficiency against `base` within the domain [-].

    Raises:
        IdentificationError: fewer working points than parameters, or no answer at the samples.
    """
    raise NotImplementedError
