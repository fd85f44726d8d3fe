# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Tables of what effects change on top of the closed form.

The closed form has jumps where the friction of a motor changes its direction. Effects move them to
other displacement ratios. The tables therefore hold two things: the shift to the displacement ratio
at which the closed form turns the output as fast as the model with effects does, and the engine
torque that the effects take then. Both are smooth where the jumps are not.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.errors import InputError
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.physics.balance import BalanceSolver
from hmcvt_core.physics.regimes import Senses
from hmcvt_core.transmission.ranges import Array, OperatingPoints, Range, Solution

BOUND = 0.002
"""Error of the efficiency that the tables keep unless another is asked for [-]."""

COVERAGE = 0.99
"""Fraction of the random points at which the bound holds."""

TABLE_SPEED = Range("engine_speed", 70.0, 240.0, "rad/s")
TABLE_LOAD = Range("load_torque", -500.0, 1000.0, "N m")
"""Where tables reach: what a tractor engine does, and overrun."""

TABLES_REMARK = (
    "The tables belong to the parameters as identified. Effect oil_temperature and the forms of "
    "drag that follow the oil are taken at 60 deg C; fan_drive is off."
)

MEASURED_POINTS = 100_000
_TRIAL_POINTS = 20_000
_COMPARED_POINTS = 500
_SEED = 20240503
_MAX_NODES = 100_000  # of one stage: 800 KB
_MAX_ROUNDS = 12
_PART_OF_BOUND = 0.9
"""Of the bound, that trial points keep: others have a larger error by chance."""
_SPLIT = 0.5  # intervals with this part of the largest error are split
_RESTING = 1e-9  # of the engine speed
_FIRST_STROKES = np.linspace(-1.0, 1.0, 17)
_FIRST_SPEEDS = np.linspace(TABLE_SPEED.low, TABLE_SPEED.high, 5)
# Losses change their direction at zero load: a node keeps the corner.
_FIRST_LOADS = np.array(
    [-500.0, -250.0, -100.0, -50.0, 0.0, 50.0, 100.0, 250.0, 500.0, 1000.0]
)

Axes = tuple[Array, Array, Array]


class BoundError(InputError):
    """The tables of a model would need too many nodes for a bound.

    Attributes:
        attainable: a bound that its tables keep [-].

    Args:
        stage: whose table has the largest error.
        bound: that was asked for [-].
        attainable: a bound that the tables of all stages keep [-].
    """

    def __init__(self, stage: str, bound: float, attainable: float) -> None:
        super().__init__(
            f"stage {stage}: its effects need a table of more than {_MAX_NODES} nodes for an "
            f"efficiency within {100.0 * bound:g} points; allow a larger bound, --bound "
            f"{attainable:g} is attainable"
        )
        self.attainable = attainable


class Accuracy(NamedTuple):
    """How well tables reproduce a model at random points.

    Attributes:
        bound: error of the efficiency that holds at `COVERAGE` of the points [-].
        largest: largest error of the efficiency [-].
        speed: error of output speed / engine speed at `COVERAGE` of the points [-].
        differing: part of the points at which either the model or the tables alone have an answer.
        nodes: of the tables of all stages.
    """

    bound: float
    largest: float
    speed: float
    differing: float
    nodes: int

    @property
    def kilobytes(self) -> float:
        """Size of the tables, two single-precision numbers for each node [KB]."""
        return 8.0 * self.nodes / 1024.0

    def report(self) -> str:
        """Return the accuracy as one sentence."""
        return (
            f"effects as tables of {self.nodes} nodes ({self.kilobytes:.0f} KB): efficiency "
            f"within {self.bound:.1e} ({100.0 * self.bound:.2g} percentage points) at "
            f"{100.0 * COVERAGE:g} % of {MEASURED_POINTS} random points, {self.largest:.1e} the "
            "largest of them (a sample, not a bound); "
            f"output speed within {self.speed:.1e} of the engine speed; at "
            f"{100.0 * self.differing:.2f} % of the points, next to a stall, either the model or "
            "the tables have no answer"
        )


@dataclass(frozen=True)
class EffectTable:
    """What effects change in one stage, at nodes over stroke, engine speed and load.

    Attributes:
        axes: displacement ratio [-], engine speed [rad/s], load torque [N m].
        shift: of the displacement ratio [-], shape of the axes; NaN without an answer.
        torque: engine torque to add [N m], same shape.
    """

    axes: Axes
    shift: NDArray[np.float32]
    torque: NDArray[np.float32]

    def at(self, points: OperatingPoints) -> tuple[Array, Array]:
        """Return shift and torque at points of shape (n,), interpolated linearly."""
        # Imported where used: it takes half a second.
        from scipy.interpolate import RegularGridInterpolator

        columns = np.column_stack(points[:3])
        shift = RegularGridInterpolator(self.axes, self.shift.astype(float))
        torque = RegularGridInterpolator(self.axes, self.torque.astype(float))
        return shift(columns), torque(columns)

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def corrected(self, closed: BalanceSolver, points: OperatingPoints) -> Solution:
        """Return the closed form with the effects, as the exported code works it out.

        Args:
            closed: the solver without effects.
            points: of shape (n,).
        """
        shift, torque = self.at(points)
        moved = points._replace(displacement_ratio=points.displacement_ratio + shift)
        solution = closed.solve(moved)
        return Solution.of(
            points.load_torque,
            solution.engine_torque + torque,
            solution.output_speed,
        )


def departs_from_closed_form(model: EfficiencyModel) -> bool:
    """Return whether a model answers otherwise than the closed form, errors of meters apart."""
    physical = model.without_meters()
    if physical.effects:
        return True
    # Whatever else a model may hold shows in its answers.
    points = _random_points(np.random.default_rng(_SEED), _COMPARED_POINTS)
    for part in physical.stages.values():
        affected = part.solution_at(points).engine_torque
        closed = _closed_form(part).solve(points).engine_torque
        if not np.array_equal(affected, closed, equal_nan=True):
            return True
    return False


def effect_tables(
    model: EfficiencyModel, bound: float = BOUND
) -> tuple[list[EffectTable], Accuracy]:
    """Return a table for each stage, and what they keep.

    Args:
        model: with effects; errors of meters are left out.
        bound: error of the efficiency that holds at `COVERAGE` of random points [-].

    Raises:
        BoundError: a table would need too many nodes.
    """
    parts = list(model.without_meters().stages.values())
    tables = []
    attainable = {}
    for part in parts:
        refined = _refined(part, bound)
        tables.append(refined.table)
        attainable[part.stage.name] = refined.attainable
    # All stages share one bound, so that the worst of them decides what is attainable.
    worst = max(attainable, key=attainable.__getitem__)
    if attainable[worst] > bound:
        raise BoundError(worst, bound, _rounded_up(attainable[worst]))
    return tables, _measured(parts, tables)


def _closed_form(model: EfficiencyModel) -> BalanceSolver:
    bare = EfficiencyModel(model.stage, model.parameters)
    return bare.balance("tables need the power balance")


class _Refined(NamedTuple):
    """The table of a stage that has been refined.

    Attributes:
        table: the last one, which keeps the bound if any does.
        attainable: smallest bound on the error of the efficiency that a table keeps [-].
    """

    table: EffectTable
    attainable: float


def _refined(model: EfficiencyModel, bound: float) -> _Refined:
    """Refine the table of one stage until the bound holds or it has too many nodes."""
    rng = np.random.default_rng(_SEED)
    axes: Axes = (_FIRST_STROKES, _FIRST_SPEEDS, _FIRST_LOADS)
    attainable = np.inf
    for _ in range(_MAX_ROUNDS):
        table = _table(model, axes)
        errors = _errors(model, table, _random_points(rng, _TRIAL_POINTS))[0]
        error = float(np.nanquantile(errors, COVERAGE))
        attainable = min(attainable, error / _PART_OF_BOUND)
        if attainable <= bound:
            break
        axes = _split(model, table)
        if np.prod([axis.size for axis in axes]) > _MAX_NODES:
            break
    return _Refined(table, attainable)


def _rounded_up(value: float) -> float:
    """Return the next larger number of two significant digits."""
    step = 10.0 ** (np.floor(np.log10(value)) - 1.0)
    return float(np.ceil(value / step) * step)


def _random_points(rng: np.random.Generator, count: int) -> OperatingPoints:
    return OperatingPoints(
        rng.uniform(-1.0, 1.0, count),
        rng.uniform(TABLE_SPEED.low, TABLE_SPEED.high, count),
        rng.uniform(TABLE_LOAD.low, TABLE_LOAD.high, count),
    )


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def _table(model: EfficiencyModel, axes: Axes) -> EffectTable:
    """Return shift and torque at the nodes."""
    grid = np.meshgrid(*axes, indexing="ij")
    nodes = OperatingPoints(*(column.ravel() for column in grid))
    closed = _closed_form(model)
    affected = model.solution_at(nodes)
    senses = Senses(
        np.where(affected.output_speed > 0.0, 1, -1),
        np.where(nodes.load_torque >= 0.0, 1, -1),
    )
    stroke, _ = closed.held(
        nodes.engine_speed, affected.output_speed, nodes.load_torque, senses=senses
    )
    shift = stroke - nodes.displacement_ratio
    speed_ratio = affected.output_speed / nodes.engine_speed
    rests = np.abs(speed_ratio - closed.mechanical_ratio) < _RESTING
    shift = _bridged(shift.reshape(grid[0].shape), rests.reshape(grid[0].shape), axes)
    moved = nodes._replace(displacement_ratio=nodes.displacement_ratio + shift.ravel())
    torque = affected.engine_torque - closed.solve(moved).engine_torque
    torque = torque.reshape(shift.shape)
    known = np.isfinite(torque) & np.isfinite(shift)
    return EffectTable(
        axes,
        _extended(shift, known).astype(np.float32),
        _extended(torque, known).astype(np.float32),
    )


def _extended(values: Array, known: NDArray[np.bool_]) -> Array:
    """Return values with those of the nearest known node at the nodes next to known ones.

    So every cell with an answer at one node has numbers at all. In its part beyond a stall the
    closed form at the shifted stroke mostly has no answer.
    """
    # Imported where used: it takes half a second.
    from scipy.ndimage import binary_dilation, distance_transform_edt

    nearest = distance_transform_edt(
        ~known, return_distances=False, return_indices=True
    )
    next_to_known = binary_dilation(known, np.ones((3, 3, 3), dtype=bool))
    return np.where(next_to_known, values[tuple(nearest)], np.nan)


def _bridged(shift: Array, rests: NDArray[np.bool_], axes: Axes) -> Array:
    """Return shifts with those of a resting motor interpolated from their neighbours.

    Friction holds a motor over a range of strokes, which all turn the output as fast.
    """
    bridged = shift.copy()
    known = np.isfinite(shift) & ~rests
    for i, j in np.argwhere(rests.any(axis=0)).tolist():
        gap = rests[:, i, j]
        support = known[:, i, j]
        if support.any():
            bridged[gap, i, j] = np.interp(
                axes[0][gap], axes[0][support], shift[support, i, j]
            )
    return bridged


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def _errors(
    model: EfficiencyModel, table: EffectTable, points: OperatingPoints
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return errors of efficiency and speed ratio, and where only one of the two answers."""
    affected = model.solution_at(points)
    corrected = table.corrected(_closed_form(model), points)
    efficiency = np.abs(corrected.efficiency - affected.efficiency)
    speed = np.abs(corrected.output_speed - affected.output_speed) / points.engine_speed
    differs = np.isnan(affected.engine_torque) != np.isnan(corrected.engine_torque)
    return efficiency, speed, differs


def _split(model: EfficiencyModel, table: EffectTable) -> Axes:
    """Return axes with further nodes in the intervals that interpolate worst."""
    worst = []
    for axis in range(3):
        worst.append(_interval_errors(model, table, axis))
    limit = _SPLIT * max(float(errors.max()) for errors in worst)
    axes = []
    for nodes, errors in zip(table.axes, worst, strict=True):
        middles = 0.5 * (nodes[1:] + nodes[:-1])
        axes.append(np.sort(np.concatenate([nodes, middles[errors >= limit]])))
    return axes[0], axes[1], axes[2]


def _interval_errors(model: EfficiencyModel, table: EffectTable, axis: int) -> Array:
    """Return the error that each interval of an axis makes at its middle."""
    columns: list[Array] = list(table.axes)
    columns[axis] = 0.5 * (columns[axis][1:] + columns[axis][:-1])
    grid = np.meshgrid(*columns, indexing="ij")
    points = OperatingPoints(*(column.ravel() for column in grid))
    errors = np.nan_to_num(_errors(model, table, points)[0]).reshape(grid[0].shape)
    by_interval = np.moveaxis(errors, axis, 0).reshape(errors.shape[axis], -1)
    return np.asarray(np.quantile(by_interval, COVERAGE, axis=1))


def _measured(
    models: Sequence[EfficiencyModel], tables: Sequence[EffectTable]
) -> Accuracy:
    """Return what tables keep at fresh points, shared among the stages."""
    rng = np.random.default_rng(_SEED + 1)
    share = -(-MEASURED_POINTS // len(models))
    efficiency = []
    speed = []
    differing = []
    for model, table in zip(models, tables, strict=True):
        errors = _errors(model, table, _random_points(rng, share))
        efficiency.append(errors[0])
        speed.append(errors[1])
        differing.append(errors[2])
    all_errors = np.concatenate(efficiency)
    return Accuracy(
        bound=float(np.nanquantile(all_errors, COVERAGE)),
        largest=float(np.nanmax(all_errors)),
        speed=float(np.nanquantile(np.concatenate(speed), COVERAGE)),
        differing=float(np.mean(np.concatenate(differing))),
        nodes=sum(table.shift.size for table in tables),
    )
