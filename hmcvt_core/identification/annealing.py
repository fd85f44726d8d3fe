# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Simulated annealing, as the paper improves it (section 4.1), repeated on narrower domains.

Each improvement is a setting: how the disturbance shrinks (`Shrink`), how the temperature falls
(`cooling`) and when to stop (`threshold`). Independent chains are evaluated together, as rows of
one array; one chain and one round are the paper's algorithm.

Eq. (19) leaves open along which axes the domain of the parameters is measured. Where parameters are
tied, the valley is narrow and lies across the axes, and moves that fit its width no longer follow
its length. Each round after the first therefore anneals again, by the same eqs (19) and (20), on
the domain that the chains of the round before have left: the box of their better ends along their
principal axes [step directions from the covariance of the walk: Vanderbilt & Louie 1984, J. Comput.
Phys. 56].
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError

Array = NDArray[np.float64]
Objective = Callable[[Array], Array]
"""Takes points of shape (m, d), gives values of shape (m,); NaN counts as infinitely bad."""
Shrink = Callable[[int, Array], Array]
"""i of eq. (19), shape (m,), from the cooling steps done and from the number of steps at the slower
rate that would have cooled each chain as far, shape (m,)."""

FRACTION_OF_WIDTH = 0.1
"""L_x of eq. (19), in terms of the width of the domain."""

_DOMAIN_WIDTH = 12.0
"""Width of the domain of a later round, in standard deviations of the ends before; chosen on random
twins (`python -m studies.annealing`): with half of it some rounds contract next to the optimum."""
_COOLING_RANGE = 1e-4
"""Final by initial temperature of a later round, which begins as hot as its ends are uneven."""
_COLDEST = 1e-300
"""Initial temperature below which the ends are equal."""


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
        rounds: annealings one after the other, the later ones with the better half of the chains.
        together: whether all trial points of a chain at one temperature are drawn from the point at
            which that temperature begins, so that they are evaluated at once; else each is drawn
            from the point that the one before has left.

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
    rounds: int = 1
    together: bool = False

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
        for name in ("moves", "chains", "rounds"):
            value = getattr(self, name)
            is_whole = isinstance(value, int) and not isinstance(value, bool)
            if not is_whole or value < 1:
                raise InputError(
                    f"{name} = {value!r} is not a whole number of at least 1"
                )

    @property
    def generations(self) -> int:
        """N of eq. (19): cooling steps from t_0 to t_end at the slower rate."""
        return math.ceil(float(self.slow_steps(np.array(self.final_temperature))))

    def slow_steps(self, temperature: Array) -> Array:
        """Cooling steps at the slower rate from t_0 to a temperature, any shape."""
        slower = math.log(max(self.cooling))
        return np.log(temperature / self.initial_temperature) / slower


QUICK = Schedule(chains=8, moves=2, together=True)
"""Annealing enough where only what a local search makes of it counts."""


@dataclass(frozen=True)
class AnnealingRun:
    """State of a run after a number of temperature steps, or at its end.

    Attributes:
        ends: best point of each chain of the round, shape (chains, d), best chain first.
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
        The run as it ended; with several rounds the chains are those of the last.
    """
    low, high = np.asarray(bounds, dtype=float).T
    rng = np.random.default_rng(seed)
    shape = (schedule.chains, len(low))
    if start is None:
        points = rng.uniform(low, high, shape)
    else:
        points = np.broadcast_to(start, shape).astype(float)
    box = _Box(objective, low, high)
    chains = _Chains(box, schedule, np.diag(high - low), points, box(points), rng)
    history: list[float] = []
    for _ in range(schedule.rounds):
        step = 0
        while chains.warm.any() and not chains.below(schedule.threshold):
            chains.anneal_step(step)
            step += 1
            history.append(chains.value)
            if progress is not None:
                progress(chains.state(history, "running"))
        if chains.below(schedule.threshold):
            return chains.state(history, "threshold")
        narrower = chains.narrowed()
        if narrower is None:
            break
        chains = narrower
    return chains.state(history, "cooled")


class _Box:
    """An objective within bounds, counting its evaluations."""

    def __init__(self, objective: Objective, low: Array, high: Array) -> None:
        self._objective = objective
        self.low = low
        self.high = high
        self.evaluations = 0

    def __call__(self, points: Array) -> Array:
        """Values at points (m, d), shape (m,); infinite without an answer."""
        self.evaluations += len(points)
        values = np.asarray(self._objective(points), dtype=float)
        return np.where(np.isnan(values), np.inf, values)


class _Chains:
    """Independent chains side by side: points, best points and temperatures of one round."""

    def __init__(
        self,
        box: _Box,
        schedule: Schedule,
        domain: Array,
        points: Array,
        values: Array,
        rng: np.random.Generator,
    ) -> None:
        """Begin a round.

        Args:
            box: the objective and its bounds.
            schedule: temperatures and moves of the round.
            domain: columns are the axes of the domain, each as long as it is wide, shape (d, d).
            points: first point of each chain, shape (chains, d).
            values: objective at them, shape (chains,).
            rng: random numbers.
        """
        self._box = box
        self._schedule = schedule
        self._domain = domain
        self._rng = rng
        self._points = points
        self._values = values
        self._best = points.copy()
        self._best_values = values.copy()
        self._temperature = np.full(len(points), float(schedule.initial_temperature))

    @property
    def value(self) -> float:
        """Best value of all chains."""
        return float(self._best_values.min())

    @property
    def warm(self) -> NDArray[np.bool_]:
        """Which chains are above the final temperature; the others rest."""
        return self._temperature > self._schedule.final_temperature

    def below(self, threshold: float | None) -> bool:
        """Whether the best value is below a threshold: improvement (1)."""
        return threshold is not None and self.value < threshold

    def state(self, history: list[float], stop_reason: str) -> AnnealingRun:
        """Return the run as it stands."""
        order = np.argsort(self._best_values)
        return AnnealingRun(
            ends=self._best[order],
            value=self.value,
            temperature=float(self._temperature.max()),
            evaluations=self._box.evaluations,
            history=tuple(history),
            stop_reason=stop_reason,
        )

    def narrowed(self) -> "_Chains | None":
        """Return the chains of the next round, None where the ends span no domain.

        The principal axes of the better half of the ends span the domain, and the mean of their
        values above the best is the initial temperature. Half of the chains of the first round
        go on.
        """
        order = np.argsort(self._best_values)
        order = order[np.isfinite(self._best_values[order])]
        better = order[: (len(self._best) + 1) // 2]
        if len(better) <= self._best.shape[1]:
            return None
        values = self._best_values[better]
        temperature = float((values - values[0]).mean())
        if temperature < _COLDEST:
            return None
        schedule = replace(
            self._schedule,
            initial_temperature=temperature,
            final_temperature=_COOLING_RANGE * temperature,
        )
        surviving = order[: (self._schedule.chains + 1) // 2]
        return _Chains(
            self._box,
            schedule,
            self._principal_box(self._best[better]),
            self._best[surviving],
            self._best_values[surviving],
            self._rng,
        )

    def _principal_box(self, ends: Array) -> Array:
        """Principal axes of ends (m, d), each as long as the domain is wide, in columns."""
        width = self._box.high - self._box.low
        variances, axes = np.linalg.eigh(np.cov((ends / width).T))
        lengths = _DOMAIN_WIDTH * np.sqrt(np.maximum(variances, 0.0))
        return np.asarray(width[:, None] * axes * lengths)

    def anneal_step(self, step: int) -> None:
        """Move the warm chains at their temperatures, and cool them.

        Args:
            step: cooling steps of the round so far.
        """
        warm = np.flatnonzero(self.warm)
        temperature = self._temperature[warm]
        best_before = self._best_values[warm]
        size = self._disturbance(step, temperature)
        draws = self._schedule.moves if self._schedule.together else 1
        for _ in range(self._schedule.moves // draws):
            self._move(warm, temperature, size, draws)
        # Eq. (20): slower while the best value improves.
        improved = self._best_values[warm] < best_before
        self._temperature[warm] = temperature * np.where(
            improved, *self._schedule.cooling
        )

    def _disturbance(self, step: int, temperature: Array) -> Array:
        """0.1 (1 - i / (N + 2)) of eq. (19) for each chain, shape (chains, 1)."""
        schedule = self._schedule
        i = schedule.shrink(step, schedule.slow_steps(temperature))
        size = FRACTION_OF_WIDTH * (1.0 - i / (schedule.generations + 2.0))
        return np.asarray(size[:, None])

    def _move(
        self, warm: NDArray[np.intp], temperature: Array, size: Array, draws: int
    ) -> None:
        """Draw trial points of each warm chain, and take them by the rule of Metropolis.

        Args:
            warm: chains that move.
            temperature: of each, shape (m,).
            size: disturbance of each, shape (m, 1).
            draws: trial points of each.
        """
        random = self._rng.random((draws, len(warm), len(self._domain))) - 0.5
        # Eq. (19), along the axes of the domain.
        moved = self._points[warm] + size * (random @ self._domain.T)
        trials = reflect(moved, self._box.low, self._box.high)
        values = self._box(trials.reshape(-1, trials.shape[-1]))
        self._take(warm, temperature, trials, values.reshape(draws, -1))

    @np.errstate(divide="ignore")
    def _take(
        self,
        warm: NDArray[np.intp],
        temperature: Array,
        trials: Array,
        trial_values: Array,
    ) -> None:
        """Take trial points by the rule of Metropolis, one draw of all chains after the other.

        Args:
            warm: m chains that move.
            temperature: of each, shape (m,).
            trials: shape (draws, m, d).
            trial_values: objective at them, shape (draws, m).
        """
        luck = self._rng.random(trial_values.shape)
        # Metropolis takes a rise with probability exp(-rise / temperature).
        tolerated = -temperature * np.log(luck)
        # Some twenty chains: plain floats are faster than arrays.
        values = self._values[warm].tolist()
        best_values = self._best_values[warm].tolist()
        # Number of the trial that each chain stands at, and of its best; -1 for none of these.
        current = [-1] * len(warm)
        best = [-1] * len(warm)
        draws = zip(trial_values.tolist(), tolerated.tolist(), strict=True)
        for number, (drawn, limits) in enumerate(draws):
            for chain, (value, limit) in enumerate(zip(drawn, limits, strict=True)):
                # inf - inf is NaN: a chain that starts without any answer may wander freely.
                if value - values[chain] >= limit:
                    continue
                values[chain] = value
                current[chain] = number
                if value < best_values[chain]:
                    best_values[chain] = value
                    best[chain] = number
        self._values[warm] = values
        self._best_values[warm] = best_values
        _put(self._points, warm, trials, np.array(current))
        _put(self._best, warm, trials, np.array(best))


def _put(
    points: Array, chains: NDArray[np.intp], trials: Array, chosen: NDArray[np.intp]
) -> None:
    """Move chains to the trials they chose.

    Args:
        points: of all chains, shape (chains, d), changed in place.
        chains: m chains.
        trials: of them, shape (draws, m, d).
        chosen: number of the trial of each, shape (m,); -1 for none.
    """
    (moved,) = np.nonzero(chosen >= 0)
    points[chains[moved]] = trials[chosen[moved], moved]


def reflect(points: Array, low: Array, high: Array) -> Array:
    """Fold points back at the bounds, so that trials do not pile up on them."""
    width = high - low
    folded = np.mod(points - low, 2.0 * width)
    return low + np.where(folded > width, 2.0 * width - folded, folded)
