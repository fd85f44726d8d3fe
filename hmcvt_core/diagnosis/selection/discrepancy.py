# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Model discrepancy: smooth over the operating points, inside a box, or of the base model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..fitting.refit import Fit
from ..observations import Observations, smooth_functions
from ..settings import FORM_ALLOWANCE_DEGREE, SMOOTH_DEGREE
from ..system import Array


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """A loss that nobody listed, in some channels: smooth over a working space, or inside a box.

    Attributes:
        campaign: whose working space it is.
        channels: their indices.
        box: limits of the place, shape (2, axes); None for a smooth one.
        is_base: whether it is what a base model that is a little off leaves.
    """

    campaign: Observations
    channels: tuple[int, ...]
    box: Array | None = None
    is_base: bool = False

    def columns(self, points: Observations) -> Array:
        """Change of the readings / deviation by each coefficient, shape (channels, n, m).

        Those of one channel after another.
        """
        return np.einsum(
            "kcn,nm->cnkm",
            points.unit_discrepancy[list(self.channels)],
            self.functions(points),
        ).reshape(*points.measured.shape, -1)

    def functions(self, points: Observations) -> Array:
        """What it may be made of, shape (n, m)."""
        if self.box is not None:
            low, high = self.box[..., None]
            inside = (points.coordinates >= low) & (points.coordinates <= high)
            return inside.all(axis=0)[:, None].astype(float)
        return (
            self.campaign.smooth[0]
            if points is self.campaign
            else smooth_functions(
                points.coordinates, SMOOTH_DEGREE, self.campaign.coordinates
            )[0]
        )

    def spread(self, *scales: float) -> Array:
        """Prior standard deviations of a smooth one, by channel: the rougher, the smaller."""
        rough = 2.0 ** -(self.campaign.smooth[1] - 1.0).clip(0.0) / 2.0
        return np.asarray(np.outer(scales, rough).ravel())


def base_discrepancy(observed: Observations) -> tuple[Discrepancy, Array]:
    """A base model that is a little off in every channel, and its prior deviations."""
    loss = Discrepancy(observed, tuple(range(len(observed.channels))), is_base=True)
    return loss, loss.spread(*(channel.misfit_spread for channel in observed.channels))


def allowance_columns(fit: Fit, campaign: Observations) -> Array:
    """Columns of a refit, of a misfit of the base and of the bends of each form.

    Smooth over the working space of a campaign; shape (channels, n, p).
    """
    misfit, _ = base_discrepancy(campaign)
    degree = campaign.smooth[1]
    bends = misfit.functions(fit.observed)[
        :, (degree > 0) & (degree <= FORM_ALLOWANCE_DEGREE)
    ]
    return np.concatenate(
        [
            fit.jacobian,
            misfit.columns(fit.observed),
            *(
                fit.jacobian[..., [i]] * fit.theta[i] * bends
                for i in fit.hypothesis.size_indices
            ),
        ],
        axis=-1,
    )
