# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Statement: which effects are present, whatever else is."""

from __future__ import annotations

from dataclasses import dataclass

from ..selection.search import Names


@dataclass(frozen=True)
class Member:
    """An effect, or a class of effects that no test distinguishes, as a part of the cause.

    Attributes:
        effects: name of the effect, or of all members of the class.
        component: the part it belongs to, None where the members of a class differ in it.
        probability: that it is present, over all sets of effects and unlisted losses.
        form_fits: whether a form in the library describes it; otherwise it acts in another form.
        lost_power: mean power that it takes over the samples [W], None where its form is not known.
    """

    effects: Names
    component: str | None
    probability: float
    form_fits: bool = True
    lost_power: float | None = None

    @property
    def is_class(self) -> bool:
        """Whether no test distinguishes it from others."""
        return len(self.effects) > 1
