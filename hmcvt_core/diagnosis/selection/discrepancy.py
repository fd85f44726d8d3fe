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

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fitting.refit import Fit
from ..observations import Observations
from ..settings import FORM_ALLOWANCE, FORM_ALLOWANCE_DEGREE, SMOOTH_DEGREE
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
        smooth = self.campaign.smooth
        if points is self.campaign:
            return smooth.at_campaign
        return smooth.at(points.points)

    def prior(self, scales: Sequence[float]) -> tuple[Array, NDArray[np.intp]]:
        """Return the prior of the coefficients of a smooth discrepancy.

        The standard deviations are half of the scale, and halve with each degree above the first.
        Over two axes their squares then sum to the square of the scale.

        Args:
            scales: prior median of the discrepancy in each channel, in its unit or relative.

        Returns:
            Standard deviations, and the family of functions in a channel to which each coefficient
            belongs, shape (m,) each.
        """
        smooth = self.campaign.smooth
        part_of_scale = 0.5 * 2.0 ** -(smooth.degree - 1.0).clip(0.0)
        spread = np.outer(scales, part_of_scale).ravel()
        families = int(smooth.family.max()) + 1
        group = [smooth.family + i * families for i in range(len(scales))]
        return spread, np.concatenate(group)


def base_discrepancy(
    observed: Observations,
) -> tuple[Discrepancy, Array, NDArray[np.intp]]:
    """Return the discrepancy of a base model in every channel, and its prior."""
    channels = tuple(range(len(observed.channels)))
    discrepancy = Discrepancy(observed, channels, is_base=True)
    scales = [channel.misfit_spread for channel in observed.channels]
    return discrepancy, *discrepancy.prior(scales)


class Columns(NamedTuple):
    """Columns of a linear model and the prior of their coefficients.

    Attributes:
        columns: shape (channels, n, p).
        spread: prior standard deviations, shape (p,).
        group: number of the group with one amplitude, -1 for none, shape (p,).
    """

    columns: Array
    spread: Array
    group: NDArray[np.intp]

    def with_further(self, further: Columns) -> Columns:
        """Return these columns and further ones, whose groups are others."""
        offset = int(self.group.max(initial=-1)) + 1
        group = np.where(further.group < 0, -1, further.group + offset)
        return Columns(
            np.concatenate([self.columns, further.columns], axis=-1),
            np.append(self.spread, further.spread),
            np.append(self.group, group),
        )


class Exact(Enum):
    """What of an explanation is exact to the noise, and so has no allowance."""

    NOTHING = 0
    BASE = 1
    BASE_AND_FORMS = 2


def allowed_columns(
    fit: Fit, campaign: Observations, sizes: Array | float, exact: Exact
) -> Columns:
    """Return the columns of a refit with allowances for an inexact base and inexact forms.

    Args:
        fit: a refit.
        campaign: whose extent scales the smooth functions.
        sizes: prior standard deviations of the sizes, in typical sizes.
        exact: what has no allowance.

    Returns:
        Columns of the refit, of the base discrepancy, and of the form discrepancy of each effect.
    """
    ungrouped = np.full(len(fit.theta), -1)
    columns = Columns(fit.jacobian, fit.hypothesis.spread(sizes), ungrouped)
    if exact is Exact.BASE_AND_FORMS:
        return columns
    base, spread, group = base_discrepancy(campaign)
    if exact is Exact.NOTHING:
        of_base = Columns(base.columns(fit.observed), spread, group)
        columns = columns.with_further(of_base)
    smooth = campaign.smooth
    # A constant factor on a signature is its size.
    most = SMOOTH_DEGREE
    if len(fit.observed.channels) == 1:
        most = FORM_ALLOWANCE_DEGREE
    is_bend = (smooth.degree > 0) & (smooth.degree <= most)
    bends = base.functions(fit.observed)[:, is_bend]
    family = smooth.family[is_bend]
    # All bends of a family together have the variance of the allowance.
    spread = FORM_ALLOWANCE / np.sqrt(np.bincount(family)[family])
    for i in fit.hypothesis.size_indices:
        signature = fit.jacobian[..., [i]] * fit.theta[i]
        columns = columns.with_further(Columns(signature * bends, spread, family - 1))
    return columns
