# SPDX-License-Identifier: Apache-2.0
"""Simulated annealing: the paper's improved one (section 4.1) and the standard one beside it.

The parts are separate so that each improvement can be switched off alone: how a move is drawn
(`Disturbance`), how the temperature falls (`Cooling`) and when to stop (`threshold`). Independent
chains are evaluated together, as rows of one array; chain count 1 is the paper's algorithm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError

Array = NDArray[np.float64]
Objective = Callable[[Array], Array]
"""Takes points of shape (m, d), gives values of shape (m,); NaN counts as infinitely bad."""

SLOW_COOLING, FAST_COOLING = 0.9, 0.7  # Eq. (20)


class Disturbance(Protocol):
    """Draws the next trial points."""

    def __call__(
        self, points: Array, width: Array, generation: int, last: int, rng: np.random.Generator
    ) -> Array:
        """Move points of shape (m, d); `width` (d,) is that of the bounds."""


class Cooling(Protocol):
    """Gives the factor by which each chain's temperature falls."""

    def __call__(self, improved: NDArray[np.bool_]) -> Array:
        """`improved` (m,) tells which chains found a new best in this generation."""


@dataclass(frozen=True)
class ShrinkingDisturbance:
    """Eq. (19): x + L_x (rand - 0.5) (1 - i / (N + 2)), L_x = 0.1 of the width.

    `generation` is i; `last` is N, the number of cooling steps at the slower rate 0.9.
    """

    part_of_width: float = 0.1

    def __call__(
        self, points: Array, width: Array, generation: int, last: int, rng: np.random.Generator
    ) -> Array:
        """See `Disturbance`."""
        shrink = 1.0 - generation / (last + 2.0)
        return points + self.part_of_width * width * (rng.random(points.shape) - 0.5) * shrink


@dataclass(frozen=True)
class ConstantDisturbance:
    """The standard algorithm's move: the same range from first to last."""

    part_of_width: float = 0.1

    def __call__(
        self, points: Array, width: Array, generation: int, last: int, rng: np.random.Generator
    ) -> Array:
        """See `Disturbance`."""
        return points + self.part_of_width * width * (rng.random(points.shape) - 0.5)


@dataclass(frozen=True)
class AdaptiveCooling:
    """Eq. (20): cool slowly (0.9) while the best value improves, fast (0.7) while it does not."""

    slow: float = SLOW_COOLING
    fast: float = FAST_COOLING

    def __call__(self, improved: NDArray[np.bool_]) -> Array:
        """See `Cooling`."""
        return np.where(improved, self.slow, self.fast)


@dataclass(frozen=True)
class ConstantCooling:
    """The standard algorithm's cooling: one factor."""

    factor: float = SLOW_COOLING

    def __call__(self, improved: NDArray[np.bool_]) -> Array:
        """See `Cooling`."""
        return np.full(improved.shape, self.factor)


@dataclass(frozen=True)
class Schedule:
    """Settings of one annealing run.

    Attributes:
        disturbance, cooling: see the module.
        initial_temperature, final_temperature: t_0 and t_end, in units of the objective.
        moves: trial points per chain at each temperature.
        chains: independent chains.
        threshold: gamma of improvement (1): stop once the best value is below; None never.

    Raises:
        InputError: a setting is out of range.
    """

    disturbance: Disturbance = field(default_factory=ShrinkingDisturbance)
    cooling: Cooling = field(default_factory=AdaptiveCooling)
    initial_temperature: float = 1.0
    final_temperature: float = 1e-6
    moves: int = 20
    chains: int = 1
    threshold: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.final_temperature < self.initial_temperature < math.inf:
            raise InputError(f"temperatures {self.initial_temperature} -> "
                             f"{self.final_temperature}: need 0 < final < initial, both finite")
        for name in ("moves", "chains"):
            if getattr(self, name) < 1:
                raise InputError(f"{name} = {getattr(self, name)} is not at least 1")

    @property
    def generations(self) -> int:
        """N of eq. (19): cooling steps from t_0 to t_end at the slower rate."""
        ratio = self.final_temperature / self.initial_temperature
        return math.ceil(math.log(ratio) / math.log(SLOW_COOLING))


IMPROVED = Schedule()
STANDARD = Schedule(disturbance=ConstantDisturbance(), cooling=ConstantCooling())


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
        seed: the one given.
    """

    x: Array
    value: float
    ends: Array
    stop_reason: str
    evaluations: int
    history: tuple[float, ...]
    seed: int | None


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
    run = _Run(objective, bounds, schedule, start, np.random.default_rng(seed))
    history = []
    for state in run.steps():
        history.append(state.value)
        if progress is not None:
            progress(state)
    order = np.argsort(run.best_values)
    reached = schedule.threshold is not None and run.best_values.min() < schedule.threshold
    return AnnealingResult(
        run.best[order[0]], float(run.best_values[order[0]]), run.best[order],
        "threshold" if reached else "cooled", run.evaluations, tuple(history), seed,
    )


class _Run:
    """State of the chains; `steps` yields after every temperature step."""

    def __init__(
        self,
        objective: Objective,
        bounds: ArrayLike,
        schedule: Schedule,
        start: ArrayLike | None,
        rng: np.random.Generator,
    ) -> None:
        limits = np.asarray(bounds, dtype=float)
        if limits.ndim != 2 or limits.shape[1] != 2 or not np.isfinite(limits).all() \
                or not (limits[:, 0] < limits[:, 1]).all():
            raise InputError(f"bounds = {limits.tolist()}: need finite (lower, upper) rows")
        self.low, self.high = limits.T
        self.objective, self.schedule, self.rng = objective, schedule, rng
        shape = (schedule.chains, len(limits))
        if start is None:
            self.points = self.low + (self.high - self.low) * rng.random(shape)
        else:
            try:
                self.points = np.broadcast_to(np.asarray(start, dtype=float), shape).copy()
            except ValueError:
                raise InputError(f"start has shape {np.shape(start)}, needs {shape}") from None
            if not ((self.points >= self.low) & (self.points <= self.high)).all():
                raise InputError(f"start = {self.points.tolist()} leaves the bounds")
        self.evaluations = 0
        self.values = self.evaluate(self.points)
        self.best, self.best_values = self.points.copy(), self.values.copy()
        self.temperature = np.full(schedule.chains, float(schedule.initial_temperature))

    def evaluate(self, points: Array) -> Array:
        """Objective with NaN as infinitely bad."""
        self.evaluations += len(points)
        values = np.asarray(self.objective(points), dtype=float)
        return np.where(np.isnan(values), np.inf, values)

    def steps(self) -> Iterator[AnnealingState]:
        """Anneal; every chain that has cooled rests."""
        schedule, generation = self.schedule, 0
        while not self.below_threshold() and self.active().any():
            before = self.best_values.copy()
            for _ in range(schedule.moves):
                self.move(generation)
            self.temperature *= schedule.cooling(self.best_values < before)
            generation += 1
            winner = int(self.best_values.argmin())
            yield AnnealingState(generation, self.best[winner], float(self.best_values[winner]),
                                 float(self.temperature.max()), self.evaluations)

    def active(self) -> NDArray[np.bool_]:
        """Chains that are still warm."""
        return self.temperature > self.schedule.final_temperature

    def below_threshold(self) -> bool:
        """Improvement (1)."""
        threshold = self.schedule.threshold
        return threshold is not None and bool(self.best_values.min() < threshold)

    def move(self, generation: int) -> None:
        """Try one move in every warm chain (Metropolis rule)."""
        warm = np.flatnonzero(self.active())
        trial = self.schedule.disturbance(
            self.points[warm], self.high - self.low, generation, self.schedule.generations,
            self.rng)
        trial = reflect(trial, self.low, self.high)
        values = self.evaluate(trial)
        with np.errstate(invalid="ignore", over="ignore", under="ignore"):
            rise = values - self.values[warm]
            chance = np.exp(-np.maximum(rise, 0.0) / self.temperature[warm])
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
