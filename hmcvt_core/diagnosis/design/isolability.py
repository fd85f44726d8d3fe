# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""What the operating points of a plan can tell apart.

For effects a, b of typical size with signatures d_a, d_b (in deviations of the readings, what the
refit of the base parameters absorbs taken out):

.. math:: L_a = \|d_a\|^2, \qquad L_{ab} = \|d_a\|^2 (1 - \cos^2\angle(d_a, d_b))

L_a is how visible a is; L_ab how visible it stays when b may mimic it. Below nine (three standard
deviations) it is not.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..fitting.hypothesis import Hypothesis
from ..fitting.refit import linearise
from ..observations import Observations
from ..settings import DECISIVE_SQUARED_DEVIATIONS, MOST_PLAN_RUNS
from ..system import Array, System
from ..wording import plain, wrapped


@dataclass(frozen=True, eq=False)
class Isolability:
    """What a plan can tell apart.

    Attributes:
        effects: names, sorted.
        detectability: L of each at its typical size, shape (k,).
        separation: row a, column b: L of a when b may mimic it, shape (k, k); the diagonal is
            `detectability`.
        plan: what is to be read where.
        further: name of the channel that a bench may read besides.
        remedies: measurement that settles each effect when no operating point does, by name.
        fuller: the same if the further channel were read too; None where it is.
    """

    effects: tuple[str, ...]
    detectability: Array
    separation: Array
    plan: Observations
    further: str
    remedies: Mapping[str, str]
    fuller: Isolability | None = None

    def confused(self) -> list[dict[str, Any]]:
        """Return what helps where an effect is visible and others may mimic it, as plain data."""
        found = []
        for i in np.flatnonzero(self.detectability >= DECISIVE_SQUARED_DEVIATIONS):
            name, twins = self.effects[i], self.indistinguishable_from(self.effects[i])
            left = (
                twins
                if self.fuller is None
                else [
                    other
                    for other in twins
                    if other in self.fuller.indistinguishable_from(name)
                ]
            )
            remedies = dict.fromkeys(
                self.remedies[each] for each in (name, *left) if left
            )
            if twins:
                found.append(
                    {
                        "effect": name,
                        "indistinguishable_from": twins,
                        f"told_by_{self.further}": [
                            each for each in twins if each not in left
                        ],
                        "remedies": list(filter(None, remedies)),
                    }
                )
        return found

    def indistinguishable_from(self, effect: str) -> list[str]:
        """Return the effects that the plan cannot tell from one that it can see."""
        row = self.separation[self.effects.index(effect)]
        return [
            other
            for other, level in zip(self.effects, row, strict=True)
            if other != effect and level < DECISIVE_SQUARED_DEVIATIONS
        ]

    twins = indistinguishable_from  # the former name

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {
            "samples": len(self.plan),
            "noise": self.plan.stated_noise,
            "noise_source": self.plan.noise_source,
            "channels": [channel.name for channel in self.plan.channels],
            "threshold": DECISIVE_SQUARED_DEVIATIONS,
            "effects": [
                {
                    "effect": name,
                    "detectability": float(self.detectability[i]),
                    "visible": bool(
                        self.detectability[i] >= DECISIVE_SQUARED_DEVIATIONS
                    ),
                    "indistinguishable_from": self.indistinguishable_from(name),
                }
                for i, name in enumerate(self.effects)
            ],
            "confused": self.confused(),
            "separation": self.separation.tolist(),
        }

    def report(self, matrix: bool = False) -> str:
        """Return what can be told apart, and what would help, as text for a person.

        Args:
            matrix: whether to print `separation` too.
        """
        confused, first = self.confused(), self.plan.channels[0]
        told, hidden = [], []
        for name, level in zip(self.effects, self.detectability.tolist(), strict=True):
            if level < DECISIVE_SQUARED_DEVIATIONS:
                runs = (
                    f" ({math.ceil(DECISIVE_SQUARED_DEVIATIONS / level)})"
                    if MOST_PLAN_RUNS * level >= DECISIVE_SQUARED_DEVIATIONS
                    else ""
                )
                hidden.append(name + runs)
            elif not self.indistinguishable_from(name):
                told.append(name)
        read = ", ".join(channel.name for channel in self.plan.channels)
        lines = [
            f"{len(self.plan)} points; read: {read}",
            f"noise of the {plain(first.name)}: {first.factor * self.plan.stated_noise:.2g} "
            f"{first.unit}, {self.plan.noise_source}",
            "",
            _listed("told from all others: ", told),
        ]
        if confused:
            lines += ["", "seen, but not told from:"]
        for item in confused:
            lines.append(
                _listed(f"  {item['effect']}: ", item["indistinguishable_from"])
            )
            if by_channel := item[f"told_by_{self.further}"]:
                lines.append(
                    _listed(
                        f"    reading the {plain(self.further)} too tells it from ",
                        by_channel,
                    )
                )
            if item["remedies"]:
                lines.append(
                    _listed("    to settle it: ", ["; or ".join(item["remedies"])])
                )
        lines += [
            "",
            _listed(
                "not visible at their typical size (number: runs of the whole plan "
                "that would show it): ",
                hidden,
            ),
        ]
        if matrix:
            lines += [
                "",
                "squared deviations that the row's effect, at its typical size, leaves "
                "after the refit of the",
                "base parameters when the column's effect, in the "
                f"same order, may mimic it; visible from {DECISIVE_SQUARED_DEVIATIONS:g}:",
            ]
            width = max(map(len, self.effects))
            lines += [
                f"{name:<{width}} "
                + " ".join(f"{min(value, 99999.0):5.0f}" for value in row)
                for name, row in zip(self.effects, self.separation, strict=True)
            ]
        return "\n".join(lines)


def isolability(
    system: System, plan: Observations, base: Array, fuller: Observations | None = None
) -> Isolability:
    """Tell which effects a set of operating points can show and tell apart.

    Args:
        system: what is to stand on the bench.
        plan: what is to be read; the readings themselves are not used.
        base: scaled base parameters.
        fuller: the same plan with a further channel read; None where there is none.
    """
    # Nothing is read yet to which base parameters could be fitted.
    fit = linearise(Hypothesis(system), plan, base, np.ones(len(plan.channels)))
    found = fit.signatures
    left = fit.project_out(np.stack([change for _, change in found]))
    effects = tuple(sorted({form.name for form, _ in found}))
    index = np.array([effects.index(form.name) for form, _ in found])
    squares = np.sum(left**2, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.nan_to_num((left @ left.T) ** 2 / squares[None, :])
    alone = np.maximum(squares[:, None] - part, 0.0)
    # The worst case over the forms of each effect.
    members = [np.flatnonzero(index == i) for i in range(len(effects))]
    detectability = np.array([squares[own].min() for own in members])
    separation = np.array(
        [[alone[np.ix_(own, other)].min() for other in members] for own in members]
    )
    np.fill_diagonal(separation, detectability)
    read = {channel.name for channel in plan.channels}
    further = [channel.name for channel in system.channels if channel.name not in read]
    return Isolability(
        effects,
        detectability,
        separation,
        plan,
        (further or [system.channels[-1].name])[0],
        {form.name: form.remedy for form, _ in found},
        None if fuller is None else isolability(system, fuller, base),
    )


def _listed(title: str, names: Iterable[str]) -> str:
    return wrapped(title + (", ".join(names) or "none"), 6)
