# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Statement: whether readings agree with the base model within the noise stated for them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Look:
    """One part of the readings against its stated noise.

    Attributes:
        channel: name of the channel.
        part: which samples, in words; empty for all of them.
        samples: how many.
        ratio: root mean square of the residuals / stated noise.
        p_value: probability of a ratio at least as large at the stated noise, over all looks.
    """

    channel: str
    part: str
    samples: int
    ratio: float
    p_value: float


@dataclass(frozen=True)
class Agreement:
    """Readings against their stated noise, before any noise is estimated.

    Attributes:
        stated: whether the noise of any channel was stated; nothing can disagree otherwise.
        holds: whether no look exceeds the statement.
        ratio: the largest over the looks at all samples of a channel; 1 where nothing was stated.
        looks: those that exceed the statement, the clearest first.
    """

    stated: bool
    holds: bool
    ratio: float
    looks: tuple[Look, ...] = ()


NOTHING_STATED = Agreement(stated=False, holds=True, ratio=1.0)
