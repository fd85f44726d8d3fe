# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Checks of converted values against each other and against what a bench can show.

A value in the wrong unit is off by a known factor. Where two routes lead to one quantity, their
ratio shows it; elsewhere only sizes that no tractor transmission has are refused.
"""

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.transmission.ranges import Array

from .proposal import BY_RANGE, Column
from .shafts import plausible_exchange

_SUSPECTS = (
    (9.5493, "r/min and rad/s"),
    (1000.0, "a factor of 1000, as of kN m and N m or kW and W"),
    (1.35582, "lb ft and N m"),
    (1.34102, "kW and hp"),
    (1.35962, "kW and PS"),
    (100.0, "percent and a fraction"),
    (10.0, "bar and MPa, or a decimal point"),
    (9.80665, "kp m and N m"),
)
"""Factors between units that are mixed up, and their names."""
_SUSPECT_WIDTH = 0.03
"""Fraction by which a ratio may miss a factor and still name it; chosen on development tables."""
_AGREEMENT = 0.05
"""Fraction by which two routes to one quantity may differ in the median: meters of a bench differ
by 1 % each, and lb ft for N m by 36 %."""
_FAR_APART = 0.1
"""Fraction by which a single test differs when a meter failed; noise is a tenth of it."""
_MAX_APART = 0.25
"""Share of such tests from which the column is of another quantity."""
_MIN_TORQUE = 3.0
"""Load torque in N m that some test of a bench exceeds; a tenth of an idling tractor."""
_MIN_PRESSURE = 1e6
"""Pressure in Pa that some test of a hydrostatic unit exceeds; its charge pressure is higher."""
_MIN_EFFICIENCY = 0.3
"""Median efficiency that a bench exceeds; a wrong unit by 9.55 or 10 makes 0.1 of 0.8."""
_MIN_ENGINE_SPEED = 60.0
"""Engine speed in rad/s that some test exceeds: 573 r/min, below the idle of a tractor's engine;
turns per second stay below it."""
_WIDEST_STEP = 3.0
"""Factor between neighbouring engine speeds of a bench; between r/min and rad/s it is larger."""
_EVEN = 1.01
"""Fraction of the usual step that a step of a grid has at most."""
_FRACTION = 0.0105
"""Largest stroke if a fraction is taken for percent, with 5 % for sensors beyond full stroke."""
_NEUTRAL = 0.003
"""Stroke within which a pump that is held in neutral stays."""
_LARGE = 0.105
"""Stroke that some test exceeds where others are fractions taken for percent; ten times those."""
_FEWEST_IN_BLOCK = 3
_HOTTEST_OIL = 130.0
"""Oil temperature in deg C that some test of a bench stays below; 54 deg C are 130 deg F."""
_MIN_STROKE = 0.0151
"""Displacement ratio that some test exceeds; 1 in percent, and 1.5 % for sensors beyond it."""


def suspicion(ratio: float) -> str:
    """Return which units differ by a ratio, `""` where none do."""
    size = max(ratio, 1.0 / ratio)
    for factor, name in _SUSPECTS:
        if abs(size / factor - 1.0) < _SUSPECT_WIDTH:
            return name
    return ""


@np.errstate(divide="ignore", invalid="ignore")  # a shaft may stand
def contradictions(
    values: Mapping[str, Array], spares: Mapping[str, Array]
) -> list[str]:
    """Return where two routes to one quantity differ.

    Args:
        values: SI values by quantity, those that the samples are made of; shape (n,) each.
        spares: the same of columns that say the same again.
    """
    both = {**values, **spares}
    routes = {
        "load_torque": _load_torques(both),
        "engine_power": _engine_powers(both),
    }
    problems = []
    for quantity, ways in routes.items():
        names = list(ways)
        for other in names[1:]:
            ratio = _median_ratio(ways[other], ways[names[0]])
            if ratio is not None and abs(np.log(ratio)) > _AGREEMENT:
                problems.append(_disagreement(quantity, other, names[0], ratio))
    shafts = _by_shafts(both)
    if shafts is not None and not problems:
        way, efficiency = shafts
        ratio = _median_ratio(efficiency, both["efficiency"])
        scattered = np.mean(_far_apart(efficiency, both["efficiency"])) > _MAX_APART
        if ratio is not None and (abs(np.log(ratio)) > _AGREEMENT or scattered):
            problems.append(_disagreement("efficiency", way, "its column", ratio))
    return problems


def contradicting_tests(values: Mapping[str, Array]) -> dict[int, str]:
    """Return the few tests whose efficiency and shafts differ, by position.

    Args:
        values: SI values by quantity, shape (n,) each.
    """
    shafts = _by_shafts(values)
    if shafts is None:
        return {}
    way, efficiency = shafts
    apart = _far_apart(efficiency, values["efficiency"])
    if not apart.any() or np.mean(apart) > _MAX_APART:
        return {}  # none, or the whole column is of another quantity
    reasons = {}
    for index in np.flatnonzero(apart).tolist():
        reasons[index] = (
            f"efficiency = {values['efficiency'][index]:.4g}, but {way} gives "
            f"{efficiency[index]:.4g}"
        )
    return reasons


def _by_shafts(values: Mapping[str, Array]) -> tuple[str, Array] | None:
    """Return how the shafts give the efficiency, and its values; None without a second route."""
    loads = _load_torques(values)
    powers = _engine_powers(values)
    if "efficiency" not in values or not loads or not powers:
        return None
    (load_name, load), *_ = loads.items()
    (power_name, power), *_ = powers.items()
    return f"{load_name} / {power_name}", load * values["engine_speed"] / power


def _load_torques(values: Mapping[str, Array]) -> dict[str, Array]:
    speed = values["engine_speed"]
    ways = {}
    if "load_torque" in values:
        ways["load_torque"] = values["load_torque"]
    if "engine_torque" in values and "torque_loss" in values:
        remaining = values["engine_torque"] - values["torque_loss"]
        ways["engine_torque - torque_loss"] = remaining
    if "output_torque" in values and "output_speed" in values:
        power = values["output_torque"] * values["output_speed"]
        ways["output_torque x output_speed"] = power / speed
    if "output_power" in values:
        ways["output_power"] = values["output_power"] / speed
    return ways


def _engine_powers(values: Mapping[str, Array]) -> dict[str, Array]:
    ways = {}
    if "engine_torque" in values:
        ways["engine_torque x engine_speed"] = (
            values["engine_torque"] * values["engine_speed"]
        )
    if "engine_power" in values:
        ways["engine_power"] = values["engine_power"]
    return ways


def _median_ratio(one: Array, other: Array) -> float | None:
    ratio = one / other
    usable = ratio[np.isfinite(ratio) & (ratio > 0.0)]
    if 2 * len(usable) < len(ratio):
        return None
    return float(np.median(usable))


def _far_apart(one: Array, other: Array) -> NDArray[np.bool_]:
    """Return in which tests two routes differ by more than `_FAR_APART`; in none that lack one."""
    ratio = one / other
    usable = np.isfinite(ratio) & (ratio > 0.0)
    return usable & (np.abs(np.log(np.where(usable, ratio, 1.0))) > _FAR_APART)


def _disagreement(quantity: str, way: str, other: str, ratio: float) -> str:
    suspect = suspicion(ratio)
    hint = f": are {suspect} mixed up?" if suspect else ": one column or unit is wrong"
    return f"{quantity} by {way} is {ratio:.4g} times that by {other}{hint}"


def implausible(
    values: Mapping[str, Array],
    columns: Mapping[str, Column],
    confirmed: Collection[str] = (),
) -> list[str]:
    """Return which columns hold values so small that their unit must be another.

    Args:
        values: SI values by quantity, shape (n,) each.
        columns: where they stand.
        confirmed: quantities whose size another column confirms.
    """
    limits = (
        ("displacement_ratio", _MIN_STROKE, "is it a fraction, not percent?"),
        ("engine_speed", _MIN_ENGINE_SPEED, "does it count turns per second?"),
        ("load_torque", _MIN_TORQUE, "is it in kN m, or 1.050 a thousand?"),
        ("pressure", _MIN_PRESSURE, "is it in bar or MPa?"),
    )
    problems = []
    if "efficiency" in values and "efficiency" not in columns:
        middle = float(np.nanmedian(values["efficiency"]))
        if middle < _MIN_EFFICIENCY:
            causes = causes_of_efficiency(values) or "units of two columns mixed up"
            problems.append(
                f"efficiency by the shafts is {middle:.3g} in the middle: are {causes}?"
            )
    problems += _mixed_units(values, columns)
    for quantity, least, hint in limits:
        if quantity not in values or len(values[quantity]) < 3:
            continue
        if quantity in confirmed:
            continue
        largest = float(np.nanmax(np.abs(values[quantity]), initial=0.0))
        if 0.0 < largest < least:
            where = ""
            if quantity in columns:
                where = (
                    f" (column {columns[quantity].name!r} as {columns[quantity].unit})"
                )
            problems.append(f"{quantity} is at most {largest:.4g}{where}: {hint}")
    return problems


def changing_strokes(strokes: Array) -> list[str]:
    """Return whether strokes at an end of a table seem to be fractions taken for percent.

    Args:
        strokes: displacement ratios of all rows in their order, those included that miss another
            value, shape (n,).
    """
    small = _small_block(strokes[np.isfinite(strokes)])
    if not small:
        return []
    return [
        f"displacement_ratio is at most {_FRACTION} in {small} tests in a row and large in "
        "the others: does its unit change within the table?"
    ]


def _mixed_units(
    values: Mapping[str, Array], columns: Mapping[str, Column]
) -> list[str]:
    """Return which columns seem to be of two units, or of another one than was taken."""
    problems = []
    speeds = np.sort(values["engine_speed"][values["engine_speed"] > 0.0])
    if len(speeds) > 1:
        steps = speeds[1:] / speeds[:-1]
        widest = int(np.argmax(steps))
        if steps[widest] > _WIDEST_STEP and not _even_step(speeds, widest):
            problems.append(
                f"engine_speed is up to {speeds[widest]:.4g} rad/s in some tests and from "
                f"{speeds[widest + 1]:.4g} rad/s in the others: does its unit change within "
                "the table?"
            )
    oil = values.get("oil_temperature")
    if oil is not None and np.nanmin(oil, initial=np.inf) > _HOTTEST_OIL:
        problems.append(
            f"oil_temperature is at least {np.nanmin(oil):.4g} deg C: is it in deg F?"
        )
    column = columns.get("efficiency")
    if column is not None and column.why.endswith(BY_RANGE):
        middle = float(np.nanmedian(values["efficiency"]))
        if middle < _MIN_EFFICIENCY:
            problems.append(
                f"efficiency is {middle:.3g} in the middle, with {column.unit} taken for the "
                f"unit of column {column.name!r}, which names none"
            )
    return problems


def _even_step(speeds: Array, position: int) -> bool:
    """Return whether the step above a speed is one of a grid, as from 100 to 300 r/min.

    Args:
        speeds: rising [rad/s], shape (n,).
        position: of the speed.
    """
    settings = np.unique(speeds.round(9))
    steps = np.diff(settings)
    step = speeds[position + 1] - speeds[position]
    return bool(step <= _EVEN * np.median(steps))


def _small_block(stroke: Array) -> int:
    """Return how many tests at an end of a table have strokes in percent that are fractions.

    A sensor reads near zero in neutral, but not all values up to 1 %.
    """
    size = np.abs(stroke)
    if len(size) < 2 * _FEWEST_IN_BLOCK or size.max() < _LARGE:
        return 0
    for ordered in (size, size[::-1]):
        large = np.flatnonzero(ordered > _FRACTION)
        count = int(large[0])
        block = ordered[:count]
        if count >= _FEWEST_IN_BLOCK and block.max() > _NEUTRAL:
            return count
    return 0


def causes_of_efficiency(values: Mapping[str, Array]) -> str:
    """Return what would explain efficiencies outside 0 to 1, or `""`.

    Args:
        values: SI values by quantity, the efficiency computed from the shafts; shape (n,) each.
    """
    causes = []
    exchange = plausible_exchange(values)
    if exchange:
        causes.append(f"the {exchange} of the two shafts exchanged")
    units = _suspect_units(values["efficiency"])
    if units:
        causes.append(f"{units} mixed up")
    return ", or ".join(causes)


def _suspect_units(efficiency: Array) -> str:
    """Return which mixed-up units would explain efficiencies, shape (n,), or `""`."""
    usable = efficiency[np.isfinite(efficiency) & (efficiency > 0.0)]
    if not len(usable):
        return ""
    middle = float(np.median(usable))
    named = []
    for factor, name in _SUSPECTS:
        for ratio in (factor, 1.0 / factor):
            if 0.5 < middle / ratio < 0.95:
                named.append(name)
    return named[0] if named else ""
