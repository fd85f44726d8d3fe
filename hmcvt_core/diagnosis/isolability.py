# SPDX-License-Identifier: Apache-2.0
r"""What a set of operating points can tell apart, before or after any test is run.

For effects a, b of typical size with signatures d_a, d_b (in deviations of the readings, what the
refit of the base parameters absorbs taken out):

.. math:: L_a = \|d_a\|^2, \qquad L_{ab} = \|d_a\|^2 (1 - \cos^2\angle(d_a, d_b))

L_a is how visible a is; L_ab how visible it stays when b may mimic it. Below nine (three standard
deviations) it is not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bench import BenchSamples
from ..model import EfficiencyModel
from .candidates import Bench
from .next_tests import DECISIVE
from .observations import Observations

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Isolability:
    """What a plan can tell apart.

    Attributes:
        effects: names, sorted.
        detectability: L of each at its typical size, shape (k,).
        separation: row a, column b: L of a when b may mimic it, shape (k, k); the diagonal is
            `detectability`.
        samples: points in the plan.
        noise: standard deviation of the efficiency [-].
        channels: what is read.
    """

    effects: tuple[str, ...]
    detectability: Array
    separation: Array
    samples: int
    noise: float
    channels: tuple[str, ...]

    def twins(self, effect: str) -> tuple[str, ...]:
        """Effects that the plan cannot tell from one that it can see."""
        i = self.effects.index(effect)
        return tuple(other for j, other in enumerate(self.effects)
                     if j != i and self.separation[i, j] < DECISIVE)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {
            "samples": self.samples, "noise": self.noise, "channels": list(self.channels),
            "threshold": DECISIVE,
            "effects": [{
                "effect": name, "detectability": float(self.detectability[i]),
                "visible": bool(self.detectability[i] >= DECISIVE),
                "indistinguishable_from": list(self.twins(name)),
            } for i, name in enumerate(self.effects)],
            "separation": self.separation.tolist(),
        }

    def report(self) -> str:
        """Return the matrix as text for a person."""
        lines = [f"{self.samples} points, noise of the efficiency {self.noise:.4g}, read: "
                 f"{', '.join(self.channels)}",
                 f"L = squared deviations an effect of typical size leaves after the refit; "
                 f"visible from {DECISIVE:g}", ""]
        width = max(len(name) for name in self.effects)
        for i, name in enumerate(self.effects):
            level = self.detectability[i]
            if level < DECISIVE:
                verdict = "not visible"
            else:
                twins = self.twins(name)
                verdict = f"not told from {', '.join(twins)}" if twins else "told from all others"
            lines.append(f"  {name:<{width}}  L = {level:8.1f}  {verdict}")
        lines += ["", "L of the row when the column may mimic it:",
                  " " * (width + 2) + " ".join(f"{j + 1:>6}" for j in range(len(self.effects)))]
        for i, name in enumerate(self.effects):
            row = " ".join(f"{min(value, 99999.0):6.0f}" for value in self.separation[i])
            lines.append(f"{i + 1:>2} {name:<{width - 1}} {row}")
        return "\n".join(lines)


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
    observed = Observations.of(plan, noise)
    bench = Bench(model, observed, fitted=False)
    columns, spread = bench.shared(bench.base)
    p = columns.shape[-1]
    stacked = np.concatenate([columns.reshape(-1, p), np.diag(1.0 / spread)])
    absorbed, _ = np.linalg.qr(stacked)
    names, rows = [], []
    for _, form, linear in bench.screen(bench.kinds, bench.base):
        signature = np.concatenate([linear.columns[..., -1].ravel(), np.zeros(p)])
        names.append(form.name)
        rows.append(signature - absorbed @ (absorbed.T @ signature))
    return _isolability(names, np.array(rows), observed)


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
                       float(np.sqrt(np.mean(observed.scale[0] ** 2))),
                       tuple(channel.name for channel in observed.channels))
