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

PART_OF_WIDTH = 0.1
"""L_x of eq. (19), in terms of the width of the bounds."""


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
        initial_temperature: t_0, in units of the objective.
        final_temperature: t_end, in units of the objective.
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
        """Cooling steps at the slower rate from t_0 to a temperature, any shape."""
        slower = math.log(max(self.cooling))
        return np.log(temperature / self.initial_temperature) / slower


QUICK = Schedule(chains=8, moves=2)
"""Annealing enough where only what a local search makes of it counts."""


@dataclass(frozen=True)
class AnnealingRun:
    """State of a run after a number of temperature steps, or at its end.

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
    chains = _Chains(objective, np.asarray(bounds, dtype=float), schedule, start, seed)
    history: list[float] = []
    while True:
        if schedule.threshold is not None and chains.value < schedule.threshold:
            return chains.state(history, "threshold")  # improvement (1)
        if not chains.warm.any():
            return chains.state(history, "cooled")
        chains.anneal_step(len(history))
        history.append(chains.value)
        if progress is not None:
            progress(chains.state(history, "running"))


class _Chains:
    """Independent chains side by side: points, best points and temperatures."""

    def __init__(
        self,
        objective: Objective,
        bounds: Array,
        schedule: Schedule,
        start: ArrayLike | None,
        seed: int | None,
    ) -> None:
        self._objective = objective
        self._schedule = schedule
        self._low, self._high = bounds.T
        self._rng = np.random.default_rng(seed)
        shape = (schedule.chains, len(bounds))
        if start is None:
            self._points = self._rng.uniform(self._low, self._high, shape)
        else:
            self._points = np.broadcast_to(start, shape).astype(float)
        self._values = self._evaluate(self._points)
        self._best = self._points.copy()
        self._best_values = self._values.copy()
        self._temperature = np.full(
            schedule.chains, float(schedule.initial_temperature)
        )
        self._evaluations = schedule.chains

    @property
    def value(self) -> float:
        """Best value of all chains."""
        return float(self._best_values.min())

    @property
    def warm(self) -> NDArray[np.bool_]:
        """Which chains are above the final temperature; the others rest."""
        return self._temperature > self._schedule.final_temperature

    def state(self, history: list[float], stop_reason: str) -> AnnealingRun:
        """Return the run as it stands."""
        order = np.argsort(self._best_values)
        return AnnealingRun(
            ends=self._best[order],
            value=self.value,
            temperature=float(self._temperature.max()),
            evaluations=self._evaluations,
            history=tuple(history),
            stop_reason=stop_reason,
        )

    def anneal_step(self, step: int) -> None:
        """Move the warm chains at their temperatures, and cool them."""
        warm = np.flatnonzero(self.warm)
        temperature = self._temperature[warm]
        best_before = self._best_values[warm]
        size = self._disturbance(step, temperature)
        for _ in range(self._schedule.moves):
            self._move(warm, temperature, size)
        # Eq. (20): slower while the best value improves.
        improved = self._best_values[warm] < best_before
        self._temperature[warm] = temperature * np.where(
            improved, *self._schedule.cooling
        )

    def _disturbance(self, step: int, temperature: Array) -> Array:
        """L_x (1 - i / (N + 2)) of eq. (19) for each chain, in terms of the width, (chains, 1)."""
        schedule = self._schedule
        i = schedule.shrink(step, schedule.slow_steps(temperature))
        size = PART_OF_WIDTH * (1.0 - i / (schedule.generations + 2.0))
        return np.asarray(size[:, None])

    def _move(self, warm: NDArray[np.intp], temperature: Array, size: Array) -> None:
        """Try one point per warm chain, and take it by the rule of Metropolis."""
        shape = (len(warm), len(self._low))
        random = self._rng.random(shape) - 0.5
        width = self._high - self._low
        moved = self._points[warm] + size * width * random  # eq. (19)
        trial = reflect(moved, self._low, self._high)
        values = self._evaluate(trial)
        self._evaluations += len(trial)
        with np.errstate(invalid="ignore", over="ignore", under="ignore"):
            rise = values - self._values[warm]
            chance = np.exp(-np.maximum(rise, 0.0) / temperature)
        # inf - inf is NaN: a chain that starts without any answer may wander freely.
        accepted = np.isnan(rise) | (self._rng.random(len(warm)) < chance)
        taken = warm[accepted]
        self._points[taken] = trial[accepted]
        self._values[taken] = values[accepted]
        better = taken[self._values[taken] < self._best_values[taken]]
        self._best[better] = self._points[better]
        self._best_values[better] = self._values[better]

    def _evaluate(self, points: Array) -> Array:
        values = np.asarray(self._objective(points), dtype=float)
        return np.where(np.isnan(values), np.inf, values)


def reflect(points: Array, low: Array, high: Array) -> Array:
    """Fold points back at the bounds, so that trials do not pile up on them."""
    width = high - low
    folded = np.mod(points - low, 2.0 * width)
    return low + np.where(folded > width, 2.0 * width - folded, folded)
