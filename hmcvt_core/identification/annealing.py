# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Simulated annealing, as the paper improves it (section 4.1).

Each improvement is a setting of its own: how the disturbance shrinks (`Shrink`), how the
temperature falls (`cooling`) and when to stop (`threshold`). Independent chains are evaluated
together, as rows of one array; chain count 1 is the paper's algorithm.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError

Array = NDArray[np.float64]
Objective = Callable[[Array], Array]
"""Takes points of shape (m, d), gives values of shape (m,); NaN counts as infinitely bad."""
Shrink = Callable[[int, Array], Array]
"""i of eq. (19), shape (m,), from the cooling steps done and from the number of steps at the slower
rate that would have cooled each chain as far, shape (m,)."""

PART_OF_WIDTH = 0.1  # L_x of eq. (19) / width of the bounds


def with_temperature(steps: int, slow_steps: Array) -> Array:
    """Eq. (19) read so that it agrees with (20): the disturbance is small when the run is cold."""
    return slow_steps


def with_steps(steps: int, slow_steps: Array) -> Array:
    """Eq. (19) as printed: (20) may end the run long before i reaches N."""
    return np.full_like(slow_steps, steps)


@dataclass(frozen=True)
class Schedule:
    """Settings of one annealing run; the defaults are the improved algorithm of section 4.1.

    Attributes:
        shrink: how the disturbance shrinks, see `Shrink`.
        cooling: factor of a chain's temperature, eq. (20): while its best value improves, and
            while it does not.
        initial_temperature, final_temperature: t_0 and t_end, in units of the objective.
        moves: trial points per chain at each temperature.
        chains: independent chains.
        threshold: gamma of improvement (1): stop once the best value is below; None never.

    Raises:
        InputError: a setting is out of range.
    """

    shrink: Shrink = with_temperature
    cooling: tuple[float, float] = (0.9, 0.7)
    initial_temperature: float = 1.0
    final_temperature: float = 1e-6
    moves: int = 20
    chains: int = 1
    threshold: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.final_temperature < self.initial_temperature < math.inf:
            raise InputError(
                f"temperatures {self.initial_temperature} -> "
                f"{self.final_temperature}: need 0 < final < initial, both finite"
            )
        if not all(0.0 < factor < 1.0 for factor in self.cooling):
            raise InputError(
                f"cooling = {self.cooling}: need factors above 0 and below 1"
            )
        for name in ("moves", "chains"):
            if getattr(self, name) < 1:
                raise InputError(f"{name} = {getattr(self, name)} is not at least 1")

    @property
    def generations(self) -> int:
        """N of eq. (19): cooling steps from t_0 to t_end at the slower rate."""
        return math.ceil(float(self.slow_steps(np.array(self.final_temperature))))

    def slow_steps(self, temperature: Array) -> Array:
        """Cooling steps at the slower rate from t_0 to such a temperature, any shape."""
        return np.log(temperature / self.initial_temperature) / math.log(
            max(self.cooling)
        )


@dataclass(frozen=True)
class AnnealingRun:
    """Where a run stands after so many temperature steps, or ended.

    Attributes:
        ends: best point of each chain, shape (chains, d), best chain first.
        value: objective at the first of them.
        temperature: highest among the chains.
        evaluations: points evaluated so far.
        history: best value after each temperature step.
        stop_reason: `threshold` or `cooled`; `running` until then.
    """

    ends: Array
    value: float
    temperature: float
    evaluations: int
    history: tuple[float, ...]
    stop_reason: str


def minimise(
    objective: Objective,
    bounds: ArrayLike,
    *,
    schedule: Schedule = Schedule(),
    start: ArrayLike | None = None,
    seed: int | None = 0,
    progress: Callable[[AnnealingRun], None] | None = None,
) -> AnnealingRun:
    """Minimise a function within bounds by simulated annealing.

    Args:
        objective: see `Objective`.
        bounds: shape (d, 2), lower and upper, finite.
        schedule: that of section 4.1 when left out.
        start: first points within them, shape (d,) or (chains, d); random when None.
        seed: of the random numbers; None for a new run every time.
        progress: called after each temperature step; may raise to cancel.

    Returns:
        The run as it ended.
    """
    low, high = np.asarray(bounds, dtype=float).T
    rng = np.random.default_rng(seed)
    shape = (schedule.chains, len(low))
    points = (
        rng.uniform(low, high, shape)
        if start is None
        else np.broadcast_to(start, shape).astype(float)
    )
    values = _values(objective, points)
    best, best_values, evaluations = points.copy(), values.copy(), len(points)
    temperature = np.full(schedule.chains, float(schedule.initial_temperature))
    history: list[float] = []

    def run(stop_reason: str) -> AnnealingRun:
        order = np.argsort(best_values)
        return AnnealingRun(
            best[order],
            float(best_values.min()),
            float(temperature.max()),
            evaluations,
            tuple(history),
            stop_reason,
        )

    while schedule.threshold is None or best_values.min() >= schedule.threshold:
        # A chain that has cooled rests.
        warm = np.flatnonzero(temperature > schedule.final_temperature)
        if not len(warm):
            return run("cooled")
        i = schedule.shrink(len(history), schedule.slow_steps(temperature[warm]))
        size = PART_OF_WIDTH * (1.0 - i / (schedule.generations + 2.0))  # Eq. (19)
        before, warmth = best_values[warm], temperature[warm]
        for _ in range(schedule.moves):
            moves = rng.random((len(warm), len(low))) - 0.5
            trial = reflect(
                points[warm] + size[:, None] * (high - low) * moves, low, high
            )
            found = _values(objective, trial)
            evaluations += len(trial)
            with np.errstate(invalid="ignore", over="ignore", under="ignore"):
                rise = found - values[warm]
                chance = np.exp(-np.maximum(rise, 0.0) / warmth)  # Metropolis rule
            # inf - inf: a chain that starts without any answer may wander freely.
            accepted = np.isnan(rise) | (rng.random(len(warm)) < chance)
            taken = warm[accepted]
            points[taken], values[taken] = trial[accepted], found[accepted]
            better = taken[values[taken] < best_values[taken]]
            best[better], best_values[better] = points[better], values[better]
        temperature[warm] = warmth * np.where(
            best_values[warm] < before, *schedule.cooling
        )
        history.append(float(best_values.min()))
        if progress is not None:
            progress(run("running"))
    return run("threshold")


def _values(objective: Objective, points: Array) -> Array:
    values = np.asarray(objective(points), dtype=float)
    return np.where(np.isnan(values), np.inf, values)


def reflect(points: Array, low: Array, high: Array) -> Array:
    """Fold points back at the bounds, so that trials do not pile up on them."""
    width = high - low
    folded = np.mod(points - low, 2.0 * width)
    return low + np.where(folded > width, 2.0 * width - folded, folded)
