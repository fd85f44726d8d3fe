# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Which effects the operating points of a plan can show and distinguish.

For effects a, b of typical size with signatures d_a, d_b (in deviations of the readings, without
what the refit of the base parameters absorbs):

.. math:: L_a = \|d_a\|^2, \qquad L_{ab} = \|d_a\|^2 (1 - \cos^2\angle(d_a, d_b))

L_a is how visible a is; L_ab how visible it stays when b may mimic it. Below nine (three standard
deviations) it is not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...files import picture, preformatted
from ..fitting.hypothesis import Hypothesis
from ..fitting.refit import linearise
from ..observations import Observations
from ..settings import DECISIVE_SQUARED_DEVIATIONS, MAX_PLAN_RUNS
from ..system import Array, System
from ..wording import plain, wrapped

_LARGEST_PRINTED = 99999.0
_INDENT = 6


@dataclass(frozen=True, eq=False)
class Isolability:
    """Which effects a plan can show and distinguish.

    Attributes:
        effects: names, sorted.
        detectability: L of each at its typical size, shape (k,).
        separation: row a, column b: L of a when b may mimic it, shape (k, k); the diagonal is
            `detectability`.
        plan: the operating points and channels.
        further: name of the channel that a bench may read in addition.
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

    def indistinguishable_from(self, effect: str) -> list[str]:
        """Return the effects that the plan cannot distinguish from one that it can see."""
        row = self.separation[self.effects.index(effect)]
        twins = []
        for other, level in zip(self.effects, row, strict=True):
            if other != effect and level < DECISIVE_SQUARED_DEVIATIONS:
                twins.append(other)
        return twins

    def twins(self, effect: str) -> list[str]:
        """Return `indistinguishable_from(effect)`; an earlier name."""
        return self.indistinguishable_from(effect)

    def confused(self) -> list[dict[str, Any]]:
        """Return what helps where an effect is visible and others may mimic it, as plain data."""
        entries = []
        for name, level in zip(self.effects, self.detectability, strict=True):
            twins = self.indistinguishable_from(name)
            if level < DECISIVE_SQUARED_DEVIATIONS or not twins:
                continue
            remaining = twins
            if self.fuller is not None:
                twins_in_fuller = self.fuller.indistinguishable_from(name)
                remaining = [other for other in twins if other in twins_in_fuller]
            separated = [other for other in twins if other not in remaining]
            entries.append(
                {
                    "effect": name,
                    "indistinguishable_from": twins,
                    f"told_by_{self.further}": separated,
                    "remedies": self._remedies(name, remaining),
                }
            )
        return entries

    def _remedies(self, effect: str, remaining: Sequence[str]) -> list[str]:
        """Measurements that separate an effect from those that no channel separates."""
        if not remaining:
            return []
        remedies = [self.remedies[name] for name in (effect, *remaining)]
        return [remedy for remedy in dict.fromkeys(remedies) if remedy]

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        effects = []
        for name, level in zip(self.effects, self.detectability, strict=True):
            effects.append(
                {
                    "effect": name,
                    "detectability": float(level),
                    "visible": bool(level >= DECISIVE_SQUARED_DEVIATIONS),
                    "indistinguishable_from": self.indistinguishable_from(name),
                }
            )
        return {
            "samples": len(self.plan),
            "noise": self.plan.stated_noise,
            "noise_source": self.plan.noise_source,
            "channels": [channel.name for channel in self.plan.channels],
            "threshold": DECISIVE_SQUARED_DEVIATIONS,
            "effects": effects,
            "confused": self.confused(),
            "separation": self.separation.tolist(),
        }

    def report(self, matrix: bool = False) -> str:
        """Return what can be distinguished, and what would help, as text for a person.

        Args:
            matrix: whether to print `separation` too.
        """
        lines = self._head()
        lines += self._confused_in_words()
        lines += [
            "",
            _listed(
                "not visible at their typical size (number: runs of the whole plan "
                "that would show it): ",
                self._hidden(),
            ),
        ]
        if matrix:
            lines += self._matrix()
        return "\n".join(lines)

    def _head(self) -> list[str]:
        channel = self.plan.channels[0]
        read = ", ".join(channel.name for channel in self.plan.channels)
        noise = channel.factor * self.plan.stated_noise
        certain = [
            name
            for name, level in zip(self.effects, self.detectability, strict=True)
            if level >= DECISIVE_SQUARED_DEVIATIONS
            and not self.indistinguishable_from(name)
        ]
        return [
            f"{len(self.plan)} points; read: {read}",
            f"noise of the {plain(channel.name)}: {noise:.2g} "
            f"{channel.unit}, {self.plan.noise_source}",
            "",
            _listed("distinguished from all others: ", certain),
        ]

    def _confused_in_words(self) -> list[str]:
        confused = self.confused()
        if not confused:
            return []
        lines = ["", "visible, but not distinguished from:"]
        for item in confused:
            twins = item["indistinguishable_from"]
            lines.append(_listed(f"  {item['effect']}: ", twins))
            separated = item[f"told_by_{self.further}"]
            if separated:
                title = (
                    f"    reading the {plain(self.further)} too distinguishes it from "
                )
                lines.append(_listed(title, separated))
            if item["remedies"]:
                remedies = "; or ".join(item["remedies"])
                lines.append(_listed("    to settle it: ", [remedies]))
        return lines

    def _hidden(self) -> list[str]:
        """Effects that are not visible, with the runs of the plan that would show them if few."""
        hidden = []
        for name, level in zip(self.effects, self.detectability, strict=True):
            if level >= DECISIVE_SQUARED_DEVIATIONS:
                continue
            if MAX_PLAN_RUNS * level >= DECISIVE_SQUARED_DEVIATIONS:
                name += f" ({math.ceil(DECISIVE_SQUARED_DEVIATIONS / level)})"
            hidden.append(name)
        return hidden

    def _matrix(self) -> list[str]:
        lines = [
            "",
            "squared deviations that the row's effect, at its typical size, leaves "
            "after the refit of the",
            "base parameters when the column's effect, in the "
            f"same order, may mimic it; visible from {DECISIVE_SQUARED_DEVIATIONS:g}:",
        ]
        width = max(map(len, self.effects))
        for name, row in zip(self.effects, self.separation, strict=True):
            values = " ".join(f"{min(value, _LARGEST_PRINTED):5.0f}" for value in row)
            lines.append(f"{name:<{width}} {values}")
        return lines

    def plot(self, ax: Any = None) -> Any:
        """Draw the matrix of separations.

        Args:
            ax: matplotlib Axes to draw into; None makes a figure.

        Returns:
            The matplotlib figure.

        Raises:
            InputError: matplotlib is missing.
        """
        return picture(self, ax=ax)

    def _repr_html_(self) -> str:
        return preformatted(self.report())


def isolability(
    system: System, plan: Observations, base: Array, fuller: Observations | None = None
) -> Isolability:
    """Return which effects a set of operating points can show and distinguish.

    Args:
        system: what will be on the bench.
        plan: operating points and channels; the readings themselves are not used.
        base: scaled base parameters, shape (p,); nothing is measured yet to which they could be
            fitted.
        fuller: the same plan with a further channel read; None where there is none.
    """
    hypothesis = Hypothesis(system, shared_count=plan.shared_count)
    theta = hypothesis.theta(np.append(base, np.zeros(plan.shared_count)))
    fit = linearise(hypothesis, plan, theta, np.ones(len(plan.channels)))
    forms = [form for form, _ in fit.signatures]
    changes = np.stack([change for _, change in fit.signatures])
    names = np.array([form.name for form in forms])
    effects = tuple(sorted(set(names.tolist())))
    members = [np.flatnonzero(names == name) for name in effects]
    visible, distinct = _of_forms(fit.project_out(changes))
    # An effect is as visible, and as distinct, as its forms are in the worst case.
    detectability = np.array([visible[rows].min() for rows in members])
    separation = np.array(
        [
            [distinct[np.ix_(rows, others)].min() for others in members]
            for rows in members
        ]
    )
    np.fill_diagonal(separation, detectability)
    read = {channel.name for channel in plan.channels}
    unread = [channel.name for channel in system.channels if channel.name not in read]
    return Isolability(
        effects=effects,
        detectability=detectability,
        separation=separation,
        plan=plan,
        further=unread[0] if unread else system.channels[-1].name,
        remedies={form.name: form.remedy for form in forms},
        fuller=None if fuller is None else isolability(system, fuller, base),
    )


def _of_forms(signatures: Array) -> tuple[Array, Array]:
    """Return L of each form, and L when another may mimic it, shapes (f,) and (f, f)."""
    squares = np.sum(signatures**2, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        mimicked = np.nan_to_num((signatures @ signatures.T) ** 2 / squares[None, :])
    return squares, np.maximum(squares[:, None] - mimicked, 0.0)


def _listed(title: str, names: Sequence[str]) -> str:
    return wrapped(title + (", ".join(names) or "none"), _INDENT)
