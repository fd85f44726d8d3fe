# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How far the zeros of the torque meters move from session to session, as a baseline shows it.

The class of a meter is assumed. A baseline of several sessions shows whether this bench keeps it: a
meter whose zero moved by twice its class between the sessions of the sound machine will do so
again, and that is no change of the machine.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...diagnosis.observations import Observations
from ...diagnosis.results.outcome import SharedErrorEstimate

ZERO = "zero of the "
METER = " meter"
PRIOR_SESSIONS = 2.0
"""Sessions for which the class of a meter counts; chosen: one session alone barely moves it."""


def zero_scales(errors: Sequence[SharedErrorEstimate]) -> dict[str, float]:
    """Return deviation of the zeros / that of the class of each torque meter, 1 or more.

    The mean square of the zeros, with their errors, and the class as that of further sessions.

    Args:
        errors: of the sessions of the baseline.
    """
    squares: dict[str, list[float]] = {}
    for item in errors:
        is_zero = item.error.startswith(ZERO) and item.error.endswith(METER)
        if is_zero and item.session and item.expected > 0.0:
            square = item.value**2 + item.standard_deviation**2
            squares.setdefault(item.error, []).append(square / item.expected**2)
    scales = {}
    for name, values in squares.items():
        mean = (PRIOR_SESSIONS + sum(values)) / (PRIOR_SESSIONS + len(values))
        scales[name] = float(np.sqrt(max(mean, 1.0)))
    return scales


def with_scaled_zeros(
    observed: Observations, scales: Mapping[str, float]
) -> Observations:
    """Return observations whose torque meters have zeros as large as a baseline shows.

    Args:
        observed: with the errors of their meters.
        scales: of `zero_scales`.
    """
    if observed.shared_errors is None:
        return observed
    factors = [scales.get(error.name, 1.0) for error in observed.shared_names]
    errors = []
    for error, factor in zip(observed.shared_names, factors, strict=True):
        errors.append(replace(error, deviation=factor * error.deviation))
    return replace(
        observed,
        shared_errors=observed.shared_errors * np.array(factors),
        shared_names=tuple(errors),
    )
