# SPDX-License-Identifier: Apache-2.0
"""How well a mean over autocorrelated readings is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_WINDOW = 3.0  # lags summed, in correlation times
_MOST_LAGS = 4  # a quarter of the readings: further lags have too few pairs


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


def effective_size(values: Array) -> float:
    """Return the number of independent readings with as good a mean.

    The autocorrelations rho_k are summed up to the first lag M that is 3 times the sum so far,
    S = 1 + 2 sum(rho_k) (Sokal's automatic windowing): further lags add noise only. About the
    sample's own mean every rho_k comes out too small by the very variance sought; with that put
    back, variance of the mean = s^2 S / (n - 2 M - 1) = s^2 / (size - 1). Readings that alternate
    would give S < 1; that gain is not taken.

    The deviation that follows is still a fifth too small when the time constant of the noise is
    1/20 of the series: nothing in so short a series tells.

    Args:
        values: equally spaced readings, shape (n,), n at least 2.
    """
    count = len(values)
    centred = values - values.mean()
    spectrum = np.fft.rfft(centred, 1 << (2 * count - 1).bit_length())
    products = np.fft.irfft(np.abs(spectrum) ** 2)[:count // _MOST_LAGS + 1]
    if not products[0] > 0.0:
        return float(count)
    sums = np.maximum(2.0 * np.cumsum(products / products[0]) - 1.0, 1.0)
    enough = np.flatnonzero(np.arange(len(sums)) >= _WINDOW * sums)
    last = int(enough[0]) if len(enough) else len(sums) - 1
    return 1.0 + float((count - 2 * last - 1) / sums[last])


def ratio_of_means(numerator: Array, denominator: Array) -> Ratio:
    """Return mean(numerator) / mean(denominator) with its standard deviation.

    The deviation is that of the mean of `numerator - ratio denominator`: what moves both alike
    cancels.

    Args:
        numerator, denominator: equally spaced readings, shape (n,), n at least 2.

    Returns:
        NaN where the denominator is 0 on average.
    """
    base = float(denominator.mean())
    if base == 0.0:
        return Ratio(np.nan, np.nan, 2.0)
    value = float(numerator.mean()) / base
    residual = numerator - value * denominator
    size = effective_size(residual)
    return Ratio(value, float(residual.std()) / abs(base) / float(np.sqrt(size - 1.0)), size)
