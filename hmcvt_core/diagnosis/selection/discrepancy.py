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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fitting.evidence import LinearModel, fitted_model
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
        families: numbers of the families of a smooth one that are present; None for all.
    """

    campaign: Observations
    channels: tuple[int, ...]
    box: Array | None = None
    is_base: bool = False
    families: tuple[int, ...] | None = None

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
        columns = change.reshape(*points.measured.shape, -1)
        if self.families is not None:
            columns = columns[..., np.isin(self.family, self.families)]
        return np.asarray(columns)

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

    @property
    def family(self) -> NDArray[np.intp]:
        """Family of each coefficient of a smooth one with all families, shape (m,)."""
        of_one_channel = self.campaign.smooth.family
        families = int(of_one_channel.max()) + 1
        of_channels = [of_one_channel + i * families for i in range(len(self.channels))]
        return np.concatenate(of_channels)

    def prior(self, scales: Sequence[float]) -> Array:
        """Return the prior standard deviations of a smooth discrepancy with all families.

        They are half of the scale, and halve with each degree above the first. Over two axes their
        squares then sum to the square of the scale.

        Args:
            scales: prior median of the discrepancy in each channel, in its unit or relative.

        Returns:
            Shape (m,).
        """
        smooth = self.campaign.smooth
        part_of_scale = 0.5 * 2.0 ** -(smooth.degree - 1.0).clip(0.0)
        return np.outer(scales, part_of_scale).ravel()


def base_discrepancy(observed: Observations) -> tuple[Discrepancy, Array]:
    """Return the discrepancy of a base model in every channel, and its prior deviations."""
    channels = tuple(range(len(observed.channels)))
    discrepancy = Discrepancy(observed, channels, is_base=True)
    scales = [channel.misfit_spread for channel in observed.channels]
    return discrepancy, discrepancy.prior(scales)


class Columns(NamedTuple):
    """Columns of a linear model and the prior of their coefficients.

    Attributes:
        columns: shape (channels, n, p).
        spread: prior standard deviations, shape (p,).
        group: number of the family that a column belongs to, -1 for none, shape (p,).
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

    def of_families(self, families: Sequence[int]) -> Columns:
        """Return the columns without a family, and those of some families."""
        return self.where((self.group < 0) | np.isin(self.group, families))

    def where(self, kept: NDArray[np.bool_]) -> Columns:
        """Return some of the columns."""
        return Columns(self.columns[..., kept], self.spread[kept], self.group[kept])

    def fitted(
        self,
        observed: Observations,
        target: Array,
        start: tuple[Array, Array] | None = None,
    ) -> LinearModel:
        """Return the linear model of the columns; see `fitted_model`."""
        return fitted_model(
            observed, self.columns, target, self.spread, self.group, start
        )


def allowed_columns(fit: Fit, campaign: Observations, sizes: Array | float) -> Columns:
    """Return the columns of a refit with allowances for an inexact base and inexact forms.

    Args:
        fit: a refit.
        campaign: whose extent scales the smooth functions.
        sizes: prior standard deviations of the sizes, in typical sizes.

    Returns:
        Columns of the refit, of the base discrepancy, of the form discrepancy of each effect
        and of the base parameters that an effect lets vary, and of channels that show an unknown
        part of a change.
    """
    ungrouped = np.full(len(fit.theta), -1)
    columns = Columns(fit.jacobian, fit.hypothesis.spread(sizes), ungrouped)
    base, spread = base_discrepancy(campaign)
    of_base = Columns(base.columns(fit.observed), spread, base.family)
    columns = columns.with_further(of_base)
    smooth = campaign.smooth
    # A constant factor on a signature is its size.
    most = SMOOTH_DEGREE
    if len(fit.observed.channels) == 1:
        most = FORM_ALLOWANCE_DEGREE
    is_form_error = (smooth.degree > 0) & (smooth.degree <= most)
    bends = base.functions(fit.observed)[:, is_form_error]
    family = smooth.family[is_form_error]
    # All bends of a family together have the variance of the allowance.
    spread = FORM_ALLOWANCE / np.sqrt(np.bincount(family)[family])
    for i in _continuous_shapes(fit):
        signature = fit.jacobian[..., [i]] * fit.theta[i]
        columns = columns.with_further(Columns(signature * bends, spread, family - 1))
    return _with_parts_of_changes(columns, fit)


def _with_parts_of_changes(columns: Columns, fit: Fit) -> Columns:
    """Return columns extended by those of channels that show an unknown part of each effect."""
    for c, channel in enumerate(fit.observed.channels):
        if not channel.change_spread:
            continue
        for i in fit.hypothesis.size_indices:
            shown = np.zeros((*fit.target.shape, 1))
            shown[c, :, 0] = fit.jacobian[c, :, i] * fit.theta[i]
            spread = np.array([channel.change_spread])
            columns = columns.with_further(Columns(shown, spread, np.array([-1])))
    return columns


def _continuous_shapes(fit: Fit) -> list[int]:
    """Return the indices of the parameters that a smooth factor may multiply, point by point.

    They are the size of each effect, and the base parameters that an effect lets vary.
    """
    names = fit.hypothesis.system.base.names
    varied = {
        name
        for effect in fit.hypothesis.effects
        for name in getattr(effect, "varied", ())
    }
    bent = fit.hypothesis.size_indices.tolist()
    return bent + [i for i, name in enumerate(names) if name in varied]
