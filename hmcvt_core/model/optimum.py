# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The working point that loses least, of one stage or of the whole drive line.

At a held engine speed the best displacement ratio lies next to the full-mechanical point, eps = 0.
What a tractor wants is the best pair (engine speed, displacement ratio) at the output speed and
power that the driver asks for. In each stage every engine speed needs one displacement ratio, which
the balance gives without a search; along this line of states a grid looks for the least fuel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..files import plain
from ..files.checks import is_path, wrong_type
from ..physics.balance import BalanceSolver
from ..physics.regimes import Senses
from ..transmission import ranges
from ..transmission.ranges import Array, OperatingPoints, Range
from ..transmission.stage import speed_ratio
from .domain import Domain
from .engine import Engine

Limits = tuple[float, float]
HOLDS = ("engine_speed", "output_speed")
OUTPUT_POWER = Range("output_power", 0.0, 1e6, "W", "is it in kW?")
_PART = Range("torque_reserve", 0.0, 0.9, "-", "a part of the full-load torque")
HYSTERESIS = Range("hysteresis", 0.0, 1.0, "-", "a part of the fuel, not percent")
"""Saving up to which the engaged stage is kept."""
SCAN = 65  # points of a grid on one interval
ZOOMS = 3  # grids, each between the neighbours of the lowest point of the one before
SLIP = 0.5  # part of the kinematic ratio that a stage may lose, or gain in overrun
NEXT_TO_REST = 1e-9  # part of the speed at which the motor rests
EDGE = 1e-9  # of the stroke
_CLOSE = 0.01  # of the best: stages that the first grid does not separate
_LIMIT_SLACK = 1e-5  # of the width between two limits
_BINDS = 1e-3  # of the full load
_TORQUE_STEP = 0.01  # of the engine torque: difference that gives fuel per loss
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
PARTS = 8  # of the strokes on either side of rest
START = 1e-3  # of a piece
BRACKET = 1e-5  # of a piece


@dataclass(frozen=True)
class Optimum:
    """The best working point; floats, or arrays of one shape.

    Attributes:
        displacement_ratio: best pump stroke [-].
        efficiency: at the best point [-].
        engine_speed: [rad/s]; as given for hold="engine_speed".
        load_torque: output power / engine speed [N m].
        output_speed: [rad/s].
        hold: what was held.
        limit: the limit that binds ("engine_speed low", "engine_speed high",
            "displacement_ratio low", "displacement_ratio high"), or None.
    """

    displacement_ratio: Any
    efficiency: Any
    engine_speed: Any
    load_torque: Any
    output_speed: Any
    hold: str
    limit: Any

    def to_dict(self) -> dict[str, Any]:
        """Return the optimum as plain data for JSON; None where it is unknown."""
        return dict(plain(vars(self)))

    def report(self) -> str:
        """Return the optimum as text, one line for each point."""
        points = np.broadcast_arrays(
            np.atleast_1d(np.asarray(self.displacement_ratio, dtype=float)),
            np.asarray(self.efficiency, dtype=float),
            np.asarray(self.engine_speed, dtype=float),
            np.asarray(self.load_torque, dtype=float),
            np.asarray(self.limit, dtype=object),
        )
        lines = []
        for stroke, efficiency, speed, load, limit in zip(
            *map(np.ravel, points), strict=True
        ):
            bound = f", limited by {limit}" if limit else ""
            lines.append(
                f"displacement ratio {stroke:.4f} at {speed:.2f} rad/s and {load:.1f} N m: "
                f"efficiency {100 * efficiency:.2f} %{bound}"
            )
        return "\n".join(lines)


@dataclass(frozen=True)
class DriveOptimum:
    """The best working point of the drive line; NaN, and no stage, where nothing holds the demand.

    Attributes:
        stage: engaged; None where nothing holds the demand.
        displacement_ratio: pump stroke [-].
        engine_speed: [rad/s].
        load_torque: output power / engine speed [N m].
        efficiency: of the transmission [-].
        engine_torque: [N m].
        fuel_rate: [kg/s]; NaN without an engine.
        limit: `full_load`, `engine_speed low` or `high`, `displacement_ratio low` or `high`: what
            binds, or None.
        fuel_per_loss: fuel that a further watt of loss costs [kg/J]; NaN without an engine.
    """

    stage: str | None
    displacement_ratio: float = math.nan
    engine_speed: float = math.nan
    load_torque: float = math.nan
    efficiency: float = math.nan
    engine_torque: float = math.nan
    fuel_rate: float = math.nan
    limit: str | None = None
    fuel_per_loss: float = math.nan

    def to_dict(self) -> dict[str, Any]:
        """Return the working point as plain data for JSON; None where it is unknown."""
        return dict(plain(vars(self)))

    def report(self) -> str:
        """Return the working point as text."""
        if self.stage is None:
            return "no stage holds this output speed and power"
        lines = [
            f"stage {self.stage}, displacement ratio {self.displacement_ratio:.4f}",
            f"engine {self.engine_speed:.2f} rad/s, {self.engine_torque:.1f} N m",
            f"efficiency {100 * self.efficiency:.2f} %",
        ]
        if math.isfinite(self.fuel_rate):
            lines.append(f"fuel {3600 * self.fuel_rate:.3f} kg/h")
        if self.limit is not None:
            lines.append(f"limited by {self.limit}")
        return "\n".join(lines)


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def optimum(
    solver: BalanceSolver,
    engine_speed: ArrayLike,
    load_torque: ArrayLike,
    hold: str,
    displacement_ratio: ArrayLike | None,
    output_speed: ArrayLike | None,
    engine_speed_limits: Limits,
) -> Optimum:
    """See `EfficiencyModel.optimal_displacement_ratio`."""
    if hold not in HOLDS:
        raise InputError(f"hold = {hold!r}; there is {', '.join(HOLDS)}")
    engine = ranges.ENGINE_SPEED.check(engine_speed)
    load = ranges.LOAD_TORQUE.check(load_torque)
    given = [engine, load]
    best: Callable[..., tuple[Any, ...]] = partial(_at_engine_speed, solver)
    if hold == "output_speed":
        low, high = ranges.ENGINE_SPEED.check(
            engine_speed_limits, "engine_speed_limits"
        ).tolist()
        if not low < high:
            raise InputError(
                f"engine_speed_limits = {low:g}, {high:g}: the first must be lower"
            )
        best = partial(_at_output_speed, solver, (low, high))
        given.append(
            _held_output_speed(solver, engine, load, displacement_ratio, output_speed)
        )
    if any(np.ndim(values) for values in given):
        *columns, limit = np.frompyfunc(best, len(given), 6)(*given)
        columns = [column.astype(float) for column in columns]
    else:  # in a third of the time, for a control loop waits
        *columns, limit = best(*(value.item() for value in given))
    stroke, efficiency, speed, torque, output = columns
    return Optimum(stroke, efficiency, speed, torque, output, hold, limit)


def _held_output_speed(
    solver: BalanceSolver,
    engine_speed: Array,
    load_torque: Array,
    displacement_ratio: ArrayLike | None,
    output_speed: ArrayLike | None,
) -> Array:
    """Return the output speed to hold: as given, or that at the displacement ratio now [rad/s]."""
    if output_speed is not None:
        return ranges.OUTPUT_SPEED.check(output_speed)
    if displacement_ratio is None:
        raise InputError(
            'hold="output_speed" needs displacement_ratio (now) or output_speed'
        )
    stroke = ranges.DISPLACEMENT_RATIO.check(displacement_ratio)
    columns = np.broadcast_arrays(stroke, engine_speed, load_torque)
    points = OperatingPoints(*columns)
    return np.asarray(points.solved(lambda _, at: solver.solve(at))[1])


def _at_output_speed(
    solver: BalanceSolver, limits: Limits, speed: float, torque: float, held: float
) -> tuple[Any, ...]:
    """Values of `Optimum`, but for what was held."""
    best = _best({"": Line(solver, held, speed * torque)}, *limits)
    return (
        best.displacement_ratio,
        best.efficiency,
        best.engine_speed,
        best.load_torque,
        held,
        best.limit,
    )


def _at_engine_speed(
    solver: BalanceSolver, speed: float, torque: float
) -> tuple[Any, ...]:
    """As `_at_output_speed`."""
    if solver.at_point is not None:
        stroke = _best_stroke(solver, solver.at_point, speed, torque)
        efficiency, output_speed, _ = solver.at_point(stroke, speed, torque)
    else:
        stroke = _best_on_grid(solver, speed, torque)
        points = OperatingPoints(*np.array([[stroke], [speed], [torque]]))
        solution = solver.solve(points)
        efficiency = solution.efficiency.item()
        output_speed = solution.output_speed.item()
    return (
        stroke,
        efficiency,
        speed,
        torque,
        output_speed,
        _limit("displacement_ratio", stroke, -1.0, 1.0),
    )


def _best_on_grid(solver: BalanceSolver, speed: float, torque: float) -> float:
    """Best displacement ratio at one engine speed and load torque; NaN where none will do."""
    # Friction holds the motor over a range of strokes, with a corner at either end.
    next_to_rest = np.array([1.0 - NEXT_TO_REST, 1.0 + NEXT_TO_REST])
    output = speed * solver.mechanical_ratio * next_to_rest
    rest, _ = solver.held(*np.broadcast_arrays(speed, output, torque))
    # Next to the stall a motor need not rest between the two.
    first, last = np.sort(np.clip(np.nan_to_num(rest), -1.0, 1.0)).tolist()

    def cost(stroke: Array) -> Array:
        points = np.broadcast_arrays(stroke, speed, torque)
        return -np.nan_to_num(solver.solve(OperatingPoints(*points)).efficiency)

    search = Search(cost, ((-1.0, first), (first, last), (last, 1.0))).closer(ZOOMS)
    return search.at if search.cost < 0.0 else math.nan


class Search:
    """Lowest cost on intervals: on a grid first, then ever closer to the lowest point of each.

    Attributes:
        at: the lowest point of all.
        cost: its cost; infinite where nothing is possible.
    """

    def __init__(
        self, function: Callable[[Array], Array], intervals: Sequence[Limits]
    ) -> None:
        self._function = function
        self._low, self._high = np.array(intervals).T
        self._ends = (self._low, self._high)
        self.cost = math.inf
        self.at = math.nan
        self.closer(1)

    def closer(self, times: int) -> Search:
        """Narrow the intervals a number of times; return the search itself."""
        for _ in range(times):
            low, high = self._ends
            step = (high - low) / (SCAN - 1)
            grid = low[:, None] + step[:, None] * np.arange(SCAN)
            cost = self._function(grid.ravel()).reshape(grid.shape)
            intervals = np.arange(len(grid))
            lowest = cost.argmin(axis=1)
            at = grid[intervals, lowest]
            least = cost[intervals, lowest]
            self._ends = (
                np.maximum(at - step, self._low),
                np.minimum(at + step, self._high),
            )
            candidates = list(zip(least.tolist(), at.tolist(), strict=True))
            self.cost, self.at = min([(self.cost, self.at), *candidates])
        return self


Lookup = Callable[[float, float, float], Sequence[float]]
"""Gives the efficiency first, for displacement ratio, engine speed and load torque."""


class _Peak(NamedTuple):
    """Highest efficiency on one side of rest; `stroke` runs as the square of the way from there.

    Attributes:
        efficiency: [-].
        way: from the corner, 0, to full stroke, 1.
        corner: stroke at which the motor comes to rest [-].
        reach: stroke from there to full stroke, negative below rest [-].
    """

    efficiency: float
    way: float
    corner: float
    reach: float

    @property
    def stroke(self) -> float:
        """Displacement ratio [-]."""
        return self.corner + self.reach * self.way * self.way


def _best_stroke(
    solver: BalanceSolver, lookup: Lookup, speed: float, torque: float
) -> float:
    """As `_best_on_grid`, in plain floats."""
    usual = solver.quadrant(Senses(-1 if solver.stage.reverse else 1, 1))
    # Between the two the whole flow leaks: of these strokes the one next to zero is best.
    lowest, highest = usual.resting_ratios(torque / speed)
    low = min(max(lowest, -1.0), 1.0)
    high = min(max(highest, -1.0), 1.0)
    best = max(
        _peak_beside(low, -1.0 - low, lookup, speed, torque),
        _peak_beside(high, 1.0 - high, lookup, speed, torque),
    )
    return best.stroke if best.efficiency > 0.0 else math.nan


def _peak_beside(
    corner: float, reach: float, lookup: Lookup, speed: float, torque: float
) -> _Peak:
    """Return the peak on one side of rest, see `_Peak`."""

    def efficiency_at(way: float) -> float:
        efficiency = lookup(corner + reach * way * way, speed, torque)[0]
        return efficiency if efficiency > 0.0 else 0.0  # NaN counts as lowest

    ways = [i / PARTS for i in range(PARTS + 1)]
    top, way = max((efficiency_at(way), way) for way in ways)
    peak = _Peak(top, way, corner, reach)
    if way == 0.0 and not efficiency_at(START) > top:
        return peak
    low = max(way - 1.0 / PARTS, 0.0)
    high = min(way + 1.0 / PARTS, 1.0)
    return max(peak, _Peak(*_golden(efficiency_at, low, high), corner, reach))


def _golden(value: Callable[[float], float], a: float, b: float) -> tuple[float, float]:
    """Highest value of a function with one maximum between two limits, and where."""
    c, d = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
    at_c, at_d = value(c), value(d)
    while b - a > BRACKET:
        if at_c > at_d:
            b, d, at_d = d, c, at_c
            c = b - GOLDEN * (b - a)
            at_c = value(c)
        else:
            a, c, at_c = c, d, at_d
            d = a + GOLDEN * (b - a)
            at_d = value(d)
    return max((at_c, c), (at_d, d))


@dataclass(frozen=True)
class Line:
    """What one stage costs along engine speeds at a held output speed and power."""

    solver: BalanceSolver
    output_speed: float
    output_power: float
    engine: Engine | None = None
    reserve: float = 0.0
    strokes: Limits = (-1.0, 1.0)

    def state(self, speed: Array) -> tuple[Array, Array]:
        """Displacement ratio and engine torque; NaN where the stage cannot hold the demand."""
        stroke, torque = self.solver.held(
            speed,
            np.full_like(speed, self.output_speed),
            self.output_power / speed,
            senses=Senses(1 if self.output_speed > 0.0 else -1, 1),
        )
        lowest, highest = self.strokes
        within = np.fmin(np.fmax(stroke, lowest), highest)
        return within, np.where(np.abs(stroke - within) < EDGE, torque, np.nan)

    def cost(self, speed: Array) -> Array:
        """Fuel [kg/s], or engine power [W] without an engine; infinite where it is not possible."""
        _, torque = self.state(speed)
        if self.engine is None:
            cost = torque * speed
        else:
            cost = self.engine.fuel_rate(speed, torque)
            if self.reserve > 0.0:
                highest = (1.0 - self.reserve) * self.engine.full_load_torque(speed)
                cost = np.where(torque <= highest, cost, np.nan)
        return np.where(np.isnan(cost), np.inf, cost)

    def reaches(self, low: float, high: float) -> bool:
        """Whether engine speeds between two limits may give the output."""
        ends = math.copysign(1.0, self.output_speed) * speed_ratio(
            self.solver.stage, np.array([-1.0, 1.0])
        )
        slowest = ends.min() * (1.0 - SLIP) * low
        fastest = ends.max() * (1.0 + SLIP) * high
        return bool(slowest <= abs(self.output_speed) <= fastest)

    def search(self, low: float, high: float) -> Search:
        """Search along engine speeds, on either side of that at which the motor rests.

        Friction sets a step at that speed, and often a lowest point next to it.
        """
        ratio = self.solver.mechanical_ratio
        if not ratio:
            return Search(self.cost, [(low, high)])
        next_to_rest = np.array([1.0 - NEXT_TO_REST, 1.0 + NEXT_TO_REST])
        rest = np.clip(self.output_speed / ratio * next_to_rest, low, high)
        below, above = rest.tolist()
        intervals = [(low, below), (above, high)]
        return Search(self.cost, [(a, b) for a, b in intervals if a < b])

    def at_speed(
        self, stage: str, speed: float, low: float, high: float
    ) -> DriveOptimum:
        """Return the working point of a stage at an engine speed between two limits."""
        strokes, torques = self.state(np.array([speed]))
        stroke = float(strokes[0])
        torque = float(torques[0])
        load = self.output_power / speed
        limit = _limit("engine_speed", speed, low, high)
        if limit is None:
            limit = _limit("displacement_ratio", stroke, *self.strokes)
        fuel = math.nan
        if self.engine is not None:
            fuel = self.engine.fuel_rate(speed, torque)
            full_load = self.engine.full_load_torque(speed)
            if torque > (1.0 - self.reserve - _BINDS) * full_load:
                limit = "full_load"
        return DriveOptimum(
            stage=stage,
            displacement_ratio=stroke,
            engine_speed=speed,
            load_torque=load,
            efficiency=load / torque,
            engine_torque=torque,
            fuel_rate=fuel,
            limit=limit,
            fuel_per_loss=self._fuel_per_loss(speed, torque, fuel),
        )

    def _fuel_per_loss(self, speed: float, torque: float, fuel: float) -> float:
        """Fuel that a further watt costs [kg/J]; NaN without an engine or torque."""
        if self.engine is None or not torque:
            return math.nan
        below = self.engine.fuel_rate(speed, (1.0 - _TORQUE_STEP) * torque)
        return float((fuel - below) / (_TORQUE_STEP * torque * speed))


def drive_optimum(
    stages: Mapping[str, BalanceSolver],
    output_speed: float,
    output_power: float,
    engine: Engine | None,
    engine_speed_limits: Limits,
    torque_reserve: float,
    stage: str | None,
    hysteresis: float,
    domain: Domain | None = None,
) -> DriveOptimum:
    """Find stage, engine speed and displacement ratio of least fuel at a held output.

    Args:
        stages: solver of each by name.
        output_speed: to hold [rad/s]; negative backward.
        output_power: to hold [W].
        engine: whose fuel counts and whose full-load curve holds; without one the least engine
            power is looked for.
        engine_speed_limits: lowest and highest engine speed allowed [rad/s].
        torque_reserve: part of the full-load torque to keep [-].
        stage: engaged now, which is kept unless another saves more than the part `hysteresis`.
        hysteresis: that part, 0 to 1 [-].
        domain: within which the working point has to lie; None for anywhere.

    Raises:
        InputError: input is out of range, or the stage is not known.
    """
    held = _one_number(ranges.OUTPUT_SPEED, output_speed)
    power = _one_number(OUTPUT_POWER, output_power)
    reserve = _one_number(_PART, torque_reserve)
    low, high = ranges.ENGINE_SPEED.check(
        engine_speed_limits, "engine_speed_limits"
    ).tolist()
    if engine is not None:
        _require_engine(engine)
        low = max(low, float(engine.speed[0]))
        high = min(high, float(engine.speed[-1]))
    if not low < high:
        raise InputError(
            f"engine_speed_limits = {low:g}, {high:g}: nothing lies between them and "
            "the speeds of the engine"
        )
    kept = _one_number(HYSTERESIS, hysteresis)
    if stage is not None and stage not in stages:
        raise InputError(f"stage = {stage!r}; there is {', '.join(stages)}")
    strokes = (-1.0, 1.0)
    if domain is not None:
        strokes = domain.displacement_ratio
        low, high = _speeds_inside(domain, power, low, high)
        if not low < high:
            return DriveOptimum(None)
    lines = {
        name: Line(solver, held, power, engine, reserve, strokes)
        for name, solver in stages.items()
    }
    return _best(lines, low, high, stage, kept)


def _require_engine(value: object) -> None:
    if not isinstance(value, Engine):
        hint = "read it by load_engine(path)" if is_path(value) else ""
        raise wrong_type("engine", "an Engine", value, hint)


def _one_number(limits: Range, value: object) -> float:
    """Return a value in range as a float; a text, a truth value or an array is refused."""
    checked = limits.check(value)  # type: ignore[arg-type]
    if checked.ndim:
        raise InputError(f"{limits.name} = {value!r} is not a number; allowed {limits}")
    return float(checked)


def _speeds_inside(domain: Domain, power: float, low: float, high: float) -> Limits:
    """Return the engine speeds at which speed and load torque lie inside a domain [rad/s]."""
    lowest, highest = domain.engine_speed
    least_load, most_load = domain.load_torque
    low = max(low, lowest, power / most_load)
    high = min(high, highest)
    if least_load > 0.0:
        high = min(high, power / least_load)
    return low, high


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def _best(
    lines: Mapping[str, Line],
    low: float,
    high: float,
    engaged: str | None = None,
    hysteresis: float = 0.0,
) -> DriveOptimum:
    """Best working point on the lines of several stages; see `drive_optimum`."""
    searches = {
        name: line.search(low, high)
        for name, line in lines.items()
        if line.reaches(low, high)
    }
    close = _CLOSE
    for _ in range(ZOOMS):
        lowest = min((search.cost for search in searches.values()), default=math.inf)
        promising = lowest * (1.0 + close)
        closer = {}
        for name, search in searches.items():
            in_reach = search.cost <= promising or name == engaged
            if math.isfinite(search.cost) and in_reach:
                closer[name] = search.closer(1)
        searches = closer
        close *= 2.0 / (SCAN - 1)
    if not searches:
        return DriveOptimum(None)
    best = min(searches, key=lambda name: searches[name].cost)
    if engaged in searches:
        kept = searches[engaged].cost <= searches[best].cost * (1.0 + hysteresis)
        best = str(engaged) if kept else best
    return lines[best].at_speed(best, searches[best].at, low, high)


def _limit(name: str, value: float, low: float, high: float) -> str | None:
    """Return the name of the limit that binds, if one does."""
    slack = _LIMIT_SLACK * (high - low)
    if value <= low + slack:
        return f"{name} low"
    if value >= high - slack:
        return f"{name} high"
    return None
