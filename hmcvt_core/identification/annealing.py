# SPDX-License-Identifier: Apache-2.0
"""Simulated annealing: the paper's improved one (section 4.1) and the standard one beside it.

Each improvement is a setting of its own: how the disturbance shrinks (`Shrink`), how the
temperature falls (`cooling`) and when to stop (`threshold`). Independent chains are evaluated
together, as rows of one array; chain count 1 is the paper's algorithm.
"""

from __future__ import annotations

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


def never(steps: int, slow_steps: Array) -> Array:
    """The standard algorithm's disturbance: the same range from first to last."""
    return np.zeros_like(slow_steps)


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
            raise InputError(f"temperatures {self.initial_temperature} -> "
                             f"{self.final_temperature}: need 0 < final < initial, both finite")
        if not all(0.0 < factor < 1.0 for factor in self.cooling):
            raise InputError(f"cooling = {self.cooling}: need factors above 0 and below 1")
        for name in ("moves", "chains"):
            if getattr(self, name) < 1:
                raise InputError(f"{name} = {getattr(self, name)} is not at least 1")

    @property
    def generations(self) -> int:
        """N of eq. (19): cooling steps from t_0 to t_end at the slower rate."""
        return math.ceil(float(self.slow_steps(np.array(self.final_temperature))))

    def slow_steps(self, temperature: Array) -> Array:
        """Cooling steps at the slower rate from t_0 to such a temperature, any shape."""
        return np.log(temperature / self.initial_temperature) / math.log(max(self.cooling))


IMPROVED = Schedule()
STANDARD = Schedule(shrink=never, cooling=(0.9, 0.9))


@dataclass(frozen=True)
class AnnealingState:
    """Where a run stands after one temperature step.

    Attributes:
        generation: steps done.
        best: best point so far, shape (d,).
        value: objective there.
        temperature: highest among the chains.
        evaluations: points evaluated so far.
    """

    generation: int
    best: Array
    value: float
    temperature: float
    evaluations: int


@dataclass(frozen=True)
class AnnealingResult:
    """Outcome of a run.

    Attributes:
        x: best point, shape (d,).
        value: objective there.
        ends: best point of each chain, shape (chains, d), best chain first.
        stop_reason: `threshold` or `cooled`.
        evaluations: points evaluated.
        history: best value after each temperature step.
    """

    x: Array
    value: float
    ends: Array
    stop_reason: str
    evaluations: int
    history: tuple[float, ...]


def minimise(
    objective: Objective,
    bounds: ArrayLike,
    *,
    schedule: Schedule = IMPROVED,
    start: ArrayLike | None = None,
    seed: int | None = 0,
    progress: Callable[[AnnealingState], None] | None = None,
) -> AnnealingResult:
    """Minimise a function within bounds by simulated annealing.

    Args:
        objective: see `Objective`.
        bounds: shape (d, 2), lower and upper.
        schedule: `IMPROVED` (section 4.1), `STANDARD`, or your own.
        start: first points, shape (d,) or (chains, d); random within the bounds when None.
        seed: of the random numbers; None for a new run every time.
        progress: called after each temperature step; may raise to cancel.

    Returns:
        The best point met.

    Raises:
        InputError: bounds or start are malformed.
    """
    limits = np.asarray(bounds, dtype=float)
    if limits.ndim != 2 or limits.shape[1] != 2 or not np.isfinite(limits).all() \
            or not (limits[:, 0] < limits[:, 1]).all():
        raise InputError(f"bounds = {limits.tolist()}: need finite (lower, upper) rows")
    rng = np.random.default_rng(seed)
    run = _Chains(objective, limits, _starts(start, limits, schedule.chains, rng), rng)
    threshold = -math.inf if schedule.threshold is None else schedule.threshold
    temperature = np.full(schedule.chains, float(schedule.initial_temperature))
    history: list[float] = []
    while run.best_values.min() >= threshold:
        # A chain that has cooled rests.
        warm = np.flatnonzero(temperature > schedule.final_temperature)
        if not len(warm):
            break
        i = schedule.shrink(len(history), schedule.slow_steps(temperature[warm]))
        size = PART_OF_WIDTH * (1.0 - i / (schedule.generations + 2.0))
        before = run.best_values[warm]
        for _ in range(schedule.moves):
            run.move(warm, size, temperature[warm])
        temperature[warm] *= np.where(run.best_values[warm] < before, *schedule.cooling)
        winner = int(run.best_values.argmin())
        history.append(float(run.best_values[winner]))
        if progress is not None:
            progress(AnnealingState(
                len(history), run.best[winner].copy(), history[-1], float(temperature.max()),
                run.evaluations))
    order = np.argsort(run.best_values)
    value = float(run.best_values[order[0]])
    return AnnealingResult(run.best[order[0]], value, run.best[order],
                           "threshold" if value < threshold else "cooled",
                           run.evaluations, tuple(history))


def _starts(
    start: ArrayLike | None, limits: Array, chains: int, rng: np.random.Generator
) -> Array:
    shape, (low, high) = (chains, len(limits)), limits.T
    if start is None:
        return rng.uniform(low, high, shape)
    try:
        points = np.broadcast_to(np.asarray(start, dtype=float), shape).copy()
    except ValueError:
        raise InputError(f"start has shape {np.shape(start)}, needs {shape}") from None
    if not ((points >= low) & (points <= high)).all():
        raise InputError(f"start = {points.tolist()} leaves the bounds")
    return points


class _Chains:
    """Points side by side, their values, and the best point of each chain."""

    def __init__(
        self, objective: Objective, limits: Array, points: Array, rng: np.random.Generator
    ) -> None:
        self.objective, self.rng, self.evaluations = objective, rng, 0
        self.low, self.high = limits.T
        self.points, self.values = points, self._evaluate(points)
        self.best, self.best_values = self.points.copy(), self.values.copy()

    def _evaluate(self, points: Array) -> Array:
        self.evaluations += len(points)
        values = np.asarray(self.objective(points), dtype=float)
        return np.where(np.isnan(values), np.inf, values)

    def move(self, warm: NDArray[np.intp], size: Array, temperature: Array) -> None:
        """Try one move in each warm chain (Metropolis rule).

        Args:
            warm: m chains.
            size: of the disturbance, in widths of the bounds, shape (m,).
            temperature: of these chains, shape (m,).
        """
        shape = (len(warm), len(self.low))
        moves = size[:, None] * (self.high - self.low) * (self.rng.random(shape) - 0.5)  # Eq. (19)
        trial = reflect(self.points[warm] + moves, self.low, self.high)
        values = self._evaluate(trial)
        with np.errstate(invalid="ignore", over="ignore", under="ignore"):
            rise = values - self.values[warm]
            chance = np.exp(-np.maximum(rise, 0.0) / temperature)
        # inf - inf: a chain that starts without any answer may wander freely.
        accepted = np.isnan(rise) | (self.rng.random(len(warm)) < chance)
        taken = warm[accepted]
        self.points[taken], self.values[taken] = trial[accepted], values[accepted]
        better = taken[self.values[taken] < self.best_values[taken]]
        self.best[better], self.best_values[better] = self.points[better], self.values[better]


def reflect(points: Array, low: Array, high: Array) -> Array:
    """Fold points back at the bounds, so that trials do not pile up on them."""
    width = high - low
    folded = np.mod(points - low, 2.0 * width)
    return low + np.where(folded > width, 2.0 * width - folded, folded)
