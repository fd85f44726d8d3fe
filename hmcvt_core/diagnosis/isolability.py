# SPDX-License-Identifier: Apache-2.0
r"""What a set of operating points can tell apart, before or after any test is run.

For effects a, b of typical size with signatures d_a, d_b (in deviations of the readings, what the
refit of the base parameters absorbs taken out):

.. math:: L_a = \|d_a\|^2, \qquad L_{ab} = \|d_a\|^2 (1 - \cos^2\angle(d_a, d_b))

L_a is how visible a is; L_ab how visible it stays when b may mimic it. Below nine (three standard
deviations) it is not.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .candidates import screen
from .hypothesis import Hypothesis, linearise
from .next_tests import DECISIVE
from .observations import Observations
from .system import Channel, System
from .words import plain

Array = NDArray[np.float64]
_WIDTH = 100
_MOST_REPEATS = 20


@dataclass(frozen=True)
class Confusion:
    """An effect that a plan can see and not tell from others.

    Attributes:
        effect: its name.
        twins: the others.
        by_channel: those from which reading a further channel too would tell it.
        remedies: measurements that settle it against the rest.
    """

    effect: str
    twins: tuple[str, ...]
    by_channel: tuple[str, ...]
    remedies: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Isolability:
    """What a plan can tell apart.

    Attributes:
        effects: names, sorted.
        detectability: L of each at its typical size, shape (k,).
        separation: row a, column b: L of a when b may mimic it, shape (k, k); the diagonal is
            `detectability`.
        samples: points in the plan.
        noise: standard deviation of the first channel; `noise_source` says by whom.
        channels: what is read, the first channel first.
        further: name of the channel that a bench may read besides.
        remedies: measurement that settles each effect when no operating point does, by name.
        with_further: `separation` if that channel were read too; None where it is.
    """

    effects: tuple[str, ...]
    detectability: Array
    separation: Array
    samples: int
    noise: float
    noise_source: str
    channels: tuple[Channel, ...]
    further: str
    remedies: Mapping[str, str] = field(default_factory=dict)
    with_further: Array | None = None

    def confused(self) -> tuple[Confusion, ...]:
        """Visible effects that another may mimic, visible at its own typical size or not."""
        found = []
        for i, name in enumerate(self.effects):
            twins = self.twins(name) if self.detectability[i] >= DECISIVE else ()
            if not twins:
                continue
            by_channel = () if self.with_further is None else tuple(
                other for other in twins
                if self.with_further[i, self.effects.index(other)] >= DECISIVE)
            left = [other for other in twins if other not in by_channel]
            remedies = dict.fromkeys(self.remedies.get(each, "")
                                     for each in ([name, *left] if left else []))
            found.append(Confusion(name, twins, by_channel, tuple(filter(None, remedies))))
        return tuple(found)

    def twins(self, effect: str) -> tuple[str, ...]:
        """Effects that the plan cannot tell from one that it can see."""
        i = self.effects.index(effect)
        return tuple(other for j, other in enumerate(self.effects)
                     if j != i and self.separation[i, j] < DECISIVE)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {
            "samples": self.samples, "noise": self.noise,
            "noise_source": self.noise_source,
            "channels": [channel.name for channel in self.channels],
            "threshold": DECISIVE,
            "effects": [{
                "effect": name, "detectability": float(self.detectability[i]),
                "visible": bool(self.detectability[i] >= DECISIVE),
                "indistinguishable_from": list(self.twins(name)),
            } for i, name in enumerate(self.effects)],
            "confused": [{
                "effect": item.effect, "indistinguishable_from": list(item.twins),
                f"told_by_{self.further}": list(item.by_channel), "remedies": list(item.remedies),
            } for item in self.confused()],
            "separation": self.separation.tolist(),
        }

    def report(self, matrix: bool = False) -> str:
        """Return what can be told apart, and what would help, as text for a person.

        Args:
            matrix: whether to print `separation` too.
        """
        mixed = {item.effect for item in self.confused()}
        seen = [name for name, level in zip(self.effects, self.detectability, strict=True)
                if level >= DECISIVE]
        first = self.channels[0]
        lines = [f"{self.samples} points; read: "
                 f"{', '.join(channel.name for channel in self.channels)}",
                 f"noise of the {plain(first.name)}: {first.factor * self.noise:.2g} "
                 f"{first.unit}, {self.noise_source}", ""]
        lines += _listed("told from all others: ",
                         [name for name in seen if name not in mixed] or ["none"])
        if mixed:
            lines += ["", "seen, but not told from:"]
        for item in self.confused():
            lines += _listed(f"  {item.effect}: ", item.twins)
            if item.by_channel:
                lines += _listed(f"    reading the {plain(self.further)} too tells it from ",
                                 item.by_channel)
            if item.remedies:
                lines += _listed("    to settle it: ", ["; or ".join(item.remedies)])
        lines += ["", *_listed("not visible at their typical size (number: runs of the whole plan "
                               "that would show it): ", list(_hidden(self)) or ["none"])]
        return "\n".join([*lines, *(_matrix(self) if matrix else ())])


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
    found = _of_plan(system, plan, base)
    if fuller is None:
        return found
    both = _of_plan(system, fuller, base)
    # Read alone, a channel may show effects that the plan cannot.
    index = [both.effects.index(name) for name in found.effects]
    return replace(found, with_further=both.separation[np.ix_(index, index)])


def _of_plan(system: System, plan: Observations, base: Array) -> Isolability:
    # Nothing is read yet to which base parameters could be fitted.
    fit = linearise(Hypothesis(system), plan, np.append(base, np.zeros(len(system.nuisances))),
                    np.ones(len(plan.readings)))
    data, prior = fit.absorbed
    screened = screen(fit)
    rows = np.array([change for _, _, change in screened])
    shadow = np.einsum("mcn,cnp->mp", rows, data)
    left = np.concatenate([
        (rows - np.einsum("mp,cnp->mcn", shadow, data)).reshape(len(rows), -1),
        -shadow @ prior.T], axis=1)
    effects = tuple(sorted({form.name for _, form, _ in screened}))
    index = np.array([effects.index(form.name) for _, form, _ in screened])
    detectability, separation = _separation(index, left, len(effects))
    read = len(plan.readings)
    return Isolability(
        effects, detectability, separation, len(plan), plan.usual_noise, plan.noise_source,
        system.channels[:read], system.channels[min(read, len(system.channels) - 1)].name,
        {form.name: form.remedy for _, form, _ in screened})


def _separation(index: NDArray[np.intp], left: Array, k: int) -> tuple[Array, Array]:
    """`detectability` and `separation` of k effects, the worst case over the forms of each.

    Args:
        index: the effect of each form, shape (m,).
        left: what the refit leaves of each form at its typical size, shape (m, readings).
        k: effects.
    """
    squares = np.sum(left**2, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.nan_to_num((left @ left.T) ** 2 / squares[None, :])
    alone = np.maximum(squares[:, None] - part, 0.0)
    detectability = np.array([squares[index == i].min() for i in range(k)])
    separation = np.array([[alone[np.ix_(index == i, index == j)].min() for j in range(k)]
                           for i in range(k)])
    np.fill_diagonal(separation, detectability)
    return detectability, separation


def _listed(title: str, names: Iterable[str]) -> list[str]:
    return textwrap.wrap(title + ", ".join(names), _WIDTH, subsequent_indent="      ",
                         break_on_hyphens=False)


def _hidden(found: Isolability) -> Iterable[str]:
    """Effects not seen, and how many times the plan must be run to see them."""
    for name, level in zip(found.effects, found.detectability, strict=True):
        if level < DECISIVE:
            times = math.ceil(DECISIVE / level) if level > 0.0 else _MOST_REPEATS + 1
            yield name + (f" ({times})" if times <= _MOST_REPEATS else "")


def _matrix(found: Isolability) -> list[str]:
    width = max(len(name) for name in found.effects)
    lines = ["", "squared deviations that the row's effect, at its typical size, leaves after the "
             "refit of the", f"base parameters when the column's effect may mimic it; "
             f"visible from {DECISIVE:g}:",
             " " * (width + 3) + " ".join(f"{j + 1:>6}" for j in range(len(found.effects)))]
    for i, name in enumerate(found.effects):
        row = " ".join(f"{min(value, 99999.0):6.0f}" for value in found.separation[i])
        lines.append(f"{i + 1:>2} {name:<{width}} {row}")
    return lines
