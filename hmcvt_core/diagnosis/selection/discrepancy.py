# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Model discrepancy: what neither the base model nor a listed effect explains.

A discrepancy is linear in its coefficients, which have normal priors (Kennedy & O'Hagan 2001,
J. R. Stat. Soc. B 63, 425, with polynomials in place of a Gaussian process). It is smooth over the
operating points of a campaign, or constant inside a box. Three kinds compete:

- an unlisted one, in one channel, as a cause of the gap;
- that of the base model, in all channels, because no base model is exact;
- that of the forms of effects, as a smooth factor on their signatures, because no form is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..fitting.refit import Fit
from ..observations import Observations, smooth_functions
from ..settings import FORM_ALLOWANCE_DEGREE, SMOOTH_DEGREE
from ..system import Array


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """A discrepancy in some channels: smooth over a campaign, or constant inside a box.

    Attributes:
        campaign: whose extent scales the smooth functions.
        channels: indices of the channels that have it.
        box: lower and upper limits of the coordinates, shape (2, axes); None for a smooth one.
        is_base: whether it is that of the base model rather than an unlisted cause.
    """

    campaign: Observations
    channels: tuple[int, ...]
    box: Array | None = None
    is_base: bool = False

    def columns(self, points: Observations) -> Array:
        """Return the change of reading / deviation by each coefficient.

        Args:
            points: where.

        Returns:
            Shape (channels, n, m), the coefficients of one channel after another.
        """
        units = points.unit_discrepancy[list(self.channels)]
        # k: channel with the discrepancy, c: channel read, n: point, m: function.
        change = np.einsum("kcn,nm->cnkm", units, self.functions(points))
        return np.asarray(change.reshape(*points.measured.shape, -1))

    def functions(self, points: Observations) -> Array:
        """Return the functions that it is a sum of, shape (n, m)."""
        if self.box is not None:
            low, high = self.box[..., None]
            coordinates = points.coordinates
            inside = (coordinates >= low) & (coordinates <= high)
            return inside.all(axis=0)[:, None].astype(float)
        if points is self.campaign:
            return self.campaign.smooth[0]
        within = self.campaign.coordinates
        return smooth_functions(points.coordinates, SMOOTH_DEGREE, within)[0]

    def spread(self, *scales: float) -> Array:
        """Return prior standard deviations of the coefficients of a smooth discrepancy.

        They are half of the scale, and halve with each degree above the first. Over two axes
        their squares then sum to the square of the scale.

        Args:
            scales: one for each channel, in its unit or relative.
        """
        degree = self.campaign.smooth[1]
        part_of_scale = 0.5 * 2.0 ** -(degree - 1.0).clip(0.0)
        return np.asarray(np.outer(scales, part_of_scale).ravel())


def base_discrepancy(observed: Observations) -> tuple[Discrepancy, Array]:
    """Return the discrepancy of a base model in every channel, and its prior deviations."""
    channels = tuple(range(len(observed.channels)))
    discrepancy = Discrepancy(observed, channels, is_base=True)
    scales = [channel.misfit_spread for channel in observed.channels]
    return discrepancy, discrepancy.spread(*scales)


def allowance_columns(fit: Fit, campaign: Observations) -> Array:
    """Return the columns of a refit with allowances for an inexact base and inexact forms.

    Args:
        fit: a refit with effects.
        campaign: whose extent scales the smooth functions.

    Returns:
        Columns of the refit, of the base discrepancy, and of the form discrepancy of each effect,
        shape (channels, n, p).
    """
    of_base, _ = base_discrepancy(campaign)
    degree = campaign.smooth[1]
    # A constant factor on a signature is its size.
    is_bend = (degree > 0) & (degree <= FORM_ALLOWANCE_DEGREE)
    bends = of_base.functions(fit.observed)[:, is_bend]
    parts = [fit.jacobian, of_base.columns(fit.observed)]
    for i in fit.hypothesis.size_indices:
        signature = fit.jacobian[..., [i]] * fit.theta[i]
        parts.append(signature * bends)
    return np.concatenate(parts, axis=-1)
