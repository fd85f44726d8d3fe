# SPDX-License-Identifier: Apache-2.0
r"""What a set of operating points can tell apart, before or after any test is run.

For effects a, b of typical size with signatures d_a, d_b (in deviations of the readings, what the
refit of the base parameters absorbs taken out):

.. math:: L_a = \|d_a\|^2, \qquad L_{ab} = \|d_a\|^2 (1 - \cos^2\angle(d_a, d_b))

L_a is how visible a is; L_ab how visible it stays when b may mimic it. Below nine (three standard
deviations) it is not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..model.model import EfficiencyModel
from .candidates import Bench
from .next_tests import DECISIVE
from .observations import Observations

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Confusion:
    """An effect that a plan can see and not tell from others.

    Attributes:
        effect: its name.
        twins: the others.
        by_speed: those from which reading the output speed too would tell it.
        remedies: measurements that settle it against the rest.
    """

    effect: str
    twins: tuple[str, ...]
    by_speed: tuple[str, ...]
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
        noise: standard deviation of the efficiency [-]; `noise_source` says by whom.
        channels: what is read.
        remedies: measurement that settles each effect when no operating point does, by name.
        with_speed: `separation` if the output speed were read too; None where it is.
    """

    effects: tuple[str, ...]
    detectability: Array
    separation: Array
    samples: int
    noise: float
    noise_source: str
    channels: tuple[str, ...]
    remedies: Mapping[str, str] = field(default_factory=dict)
    with_speed: Array | None = None

    def confused(self) -> tuple[Confusion, ...]:
        """Visible effects that another may mimic, visible at its own typical size or not."""
        found = []
        for i, name in enumerate(self.effects):
            twins = self.twins(name) if self.detectability[i] >= DECISIVE else ()
            if not twins:
                continue
            by_speed = () if self.with_speed is None else tuple(
                other for other in twins
                if self.with_speed[i, self.effects.index(other)] >= DECISIVE)
            left = [other for other in twins if other not in by_speed]
            remedies = dict.fromkeys(self.remedies.get(each, "")
                                     for each in ([name, *left] if left else []))
            found.append(Confusion(name, twins, by_speed, tuple(filter(None, remedies))))
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
            "noise_source": self.noise_source, "channels": list(self.channels),
            "threshold": DECISIVE,
            "effects": [{
                "effect": name, "detectability": float(self.detectability[i]),
                "visible": bool(self.detectability[i] >= DECISIVE),
                "indistinguishable_from": list(self.twins(name)),
            } for i, name in enumerate(self.effects)],
            "confused": [{
                "effect": item.effect, "indistinguishable_from": list(item.twins),
                "told_by_output_speed": list(item.by_speed), "remedies": list(item.remedies),
            } for item in self.confused()],
            "separation": self.separation.tolist(),
        }

    def report(self, matrix: bool = False) -> str:
        """Return what can be told apart, and what would help, as text for a person.

        Args:
            matrix: whether to print `separation` too.
        """
        from .isolability_report import isolability_report

        return isolability_report(self, matrix)


def separable(
    model: EfficiencyModel,
    plan: BenchSamples,
    *,
    noise: float | None = None,
) -> Isolability:
    """Tell which effects a set of operating points can show and tell apart.

    Args:
        model: formulation `power_balance`; supplies the base parameters.
        plan: operating points; the efficiency in it is not used, the presence of output speed
            and oil temperature is.
        noise: standard deviation of the efficiency [-]; None as in `diagnose`.
    """
    found = _of_plan(model, plan, noise)
    if plan.output_speed is not None:
        return found
    speed = model.output_speed(plan.displacement_ratio, plan.engine_speed, plan.load_torque,
                               plan.oil_temperature)
    both = _of_plan(model, replace(plan, output_speed=speed), noise)
    # Read alone, the output speed may show effects that the plan cannot.
    index = [both.effects.index(name) for name in found.effects]
    return replace(found, with_speed=both.separation[np.ix_(index, index)])


def _of_plan(model: EfficiencyModel, plan: BenchSamples, noise: float | None) -> Isolability:
    observed = Observations.of(plan, noise)
    bench = Bench(model, observed, fitted=False)
    columns, spread = bench.shared(bench.base)
    p = columns.shape[-1]
    stacked = np.concatenate([columns.reshape(-1, p), np.diag(1.0 / spread)])
    absorbed, _ = np.linalg.qr(stacked)
    names, rows, remedies = [], [], {}
    for _, form, linear in bench.screen(bench.kinds, bench.base):
        signature = np.concatenate([linear.columns[..., -1].ravel(), np.zeros(p)])
        names.append(form.name)
        remedies[form.name] = form.remedy
        rows.append(signature - absorbed @ (absorbed.T @ signature))
    return replace(_isolability(names, np.array(rows), observed), remedies=remedies)


def _isolability(names: list[str], left: Array, observed: Observations) -> Isolability:
    effects = tuple(sorted(set(names)))
    index = np.array([effects.index(name) for name in names])
    squares = np.sum(left**2, axis=1)
    inner = left @ left.T
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.nan_to_num(inner**2 / squares[None, :])
    alone = np.maximum(squares[:, None] - part, 0.0)
    k = len(effects)
    separation = np.empty((k, k))
    detectability = np.array([squares[index == i].min() for i in range(k)])
    for i in range(k):
        for j in range(k):
            # The worst case over the forms of both.
            separation[i, j] = alone[np.ix_(index == i, index == j)].min()
        separation[i, i] = detectability[i]
    return Isolability(effects, detectability, separation, len(observed.samples),
                       float(np.sqrt(np.mean(observed.scale[0] ** 2))), observed.noise_source,
                       tuple(channel.name for channel in observed.channels))
