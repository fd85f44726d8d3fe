# SPDX-License-Identifier: Apache-2.0
"""How well a mean over autocorrelated readings is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_WINDOW = 5.0  # lags summed, in correlation times


class Ratio(NamedTuple):
    """Ratio of two means.

    Attributes:
        value: [-].
        std: its standard deviation [-].
        effective_size: independent readings that would tell as much.
    """

    value: float
    std: float
    effective_size: float


def correlation_time(values: Array) -> float:
    """Return the integrated autocorrelation time in readings, at least 1.

    1 + 2 sum(rho_k), summed to the first lag that is 5 times the sum so far (Sokal's automatic
    windowing): further lags add noise only. Readings that alternate would give less than 1; that
    gain is not taken.

    Args:
        values: equally spaced readings, shape (n,).
    """
    count = len(values)
    centred = values - values.mean()
    if count < 2 or not np.any(centred):
        return 1.0
    size = 1 << (2 * count - 1).bit_length()
    spectrum = np.fft.rfft(centred, size)
    products = np.fft.irfft(np.abs(spectrum) ** 2, size)[:count]
    sums = 2.0 * np.cumsum(products / products[0]) - 1.0
    enough = np.flatnonzero(np.arange(count) >= _WINDOW * np.maximum(sums, 1.0))
    # Without such a lag the readings hold no two independent stretches.
    found = float(sums[enough[0]]) if len(enough) else float(sums.max())
    return max(found, 1.0)


def ratio_of_means(numerator: Array, denominator: Array) -> Ratio:
    """Return mean(numerator) / mean(denominator) with its standard deviation.

    The deviation is that of the mean of `numerator - ratio denominator`: what moves both alike
    cancels. With n readings and correlation time tau, variance of the mean =
    s^2 / (n / tau - 1), s^2 being taken about the sample's own mean.

    Args:
        numerator, denominator: equally spaced readings, shape (n,), n at least 2.
    """
    base = float(denominator.mean())
    value = float(numerator.mean()) / base
    residual = numerator - value * denominator
    # Below two independent readings a scatter says nothing about the mean.
    size = max(len(residual) / correlation_time(residual), 2.0)
    std = float(residual.std()) / abs(base) / np.sqrt(size - 1.0)
    return Ratio(value, float(std), size)
