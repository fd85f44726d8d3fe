# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which shaft is which: checks by the speed ratio, and the line that states what was taken.

The speed ratio of a hydromechanical stage is linear in the stroke, forward or as its inverse, and
does not know the torques. So a stroke that was mistyped stands out, and so do exchanged shafts.
Every stage has a separate line, so each is checked by itself.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.transmission.ranges import Array

from .proposal import Column, option

_FEWEST_TESTS = 5
_FEWEST_OF_LINE = 4
"""Tests from which a line over the stroke can be told from its inverse."""
_FEWEST_OF_SLOPE = 3
"""Tests whose speed ratio may fall as the stroke rises because speeds are exchanged."""
FALLS = ", so it falls as the stroke rises"
DOUBT = ": check the sign of the stroke, and which speed is that of the engine"
"""Note on a speed ratio that falls, and what may be wrong then."""
_MIN_SPREAD = 0.1
"""Standard deviation of the logarithm of the speed ratio from which exchanged shafts show."""
_MIN_STROKES = 0.5
"""Range of strokes from which a line and its inverse differ."""
_MIN_CURVATURE = 0.005
"""Fraction of the speed ratio that a curve must differ from a line by; slip is about as much."""
_BETTER = 0.5
"""Fraction of the spread that is left when the right shafts are taken."""
_PLAUSIBLE = (0.3, 1.0)
"""Efficiencies of a transmission at work."""
_MOST = 0.9
"""Share of the tests that must be plausible; the others may be mistyped."""
_COLD = 30.0
"""Degrees C from which the oil of a bench is warm, so that 0 and less are codes."""
_FEWEST_FOR_ODD = 8
_MAX_ODD = 3
"""Tests that may be odd; more are of another stage, or no steady tests."""
_MAX_ODD_SHARE = 0.15
_ODD_DEVIATIONS = 8.0
_MIN_DEVIATION = 0.01
"""Fraction of the middle speed ratio by which tests differ at least, by slip."""


def _speed_ratio(values: Mapping[str, Array]) -> Array | None:
    """Return output speed / engine speed; None where one of them is not known."""
    if "output_speed" not in values or "engine_speed" not in values:
        return None
    return np.asarray(values["output_speed"] / values["engine_speed"])


def tests_by_stage(
    cells: Sequence[str] | None, count: int
) -> dict[str, NDArray[np.intp]]:
    """Return the positions of the tests of every stage.

    Args:
        cells: name of the stage of every test; None where no column names it.
        count: of the tests.

    Returns:
        Positions by stage, in the order of the table; one entry `""` where no stage is named.
    """
    if cells is None:
        return {"": np.arange(count)}
    positions: dict[str, list[int]] = {}
    for position, cell in enumerate(cells):
        positions.setdefault(cell, []).append(position)
    return {stage: np.array(numbers) for stage, numbers in positions.items()}


def exchanged_shafts(
    values: Mapping[str, Array],
    columns: Mapping[str, Column],
    stages: Sequence[str] | None = None,
) -> list[str]:
    """Return why the columns of the two shafts may be exchanged; empty for no reason.

    Args:
        values: SI values by quantity, shape (n,) each.
        columns: where they stand.
        stages: of the tests; None where no column names them.
    """
    ratio = _speed_ratio(values)
    if ratio is None or not np.all(ratio > 0.0):
        return []
    if len(ratio) >= _FEWEST_TESTS and np.std(np.log(ratio)) > _MIN_SPREAD:
        exchange = _steadier_exchange(values)
        if exchange:
            return [
                "the efficiency by the shafts follows the square of the speed ratio, as when "
                f"the {exchange} of the two shafts are exchanged"
            ]
    proposed = all(
        columns[name].why if name in columns else False
        for name in ("engine_speed", "output_speed")
    )
    both_torques = {"engine_torque", "output_torque"} <= values.keys()
    confirmed = both_torques and "efficiency" in columns
    if not proposed or confirmed:
        return []
    for stage, tests in tests_by_stage(stages, len(ratio)).items():
        stroke = values["displacement_ratio"][tests]
        problems = _inverse_line(stroke, ratio[tests], columns, stage)
        if problems:
            return problems
    return []


@np.errstate(divide="ignore", invalid="ignore")  # a shaft may stand
def _efficiencies_if_exchanged(values: Mapping[str, Array]) -> dict[str, Array]:
    """Return the efficiencies by the shafts as they are (`""`) and with columns exchanged.

    Empty where speeds and torques of both shafts are not all known.
    """
    ratio = _speed_ratio(values)
    if ratio is None or not {"engine_torque", "output_torque"} <= values.keys():
        return {}
    efficiency = values["output_torque"] * ratio / values["engine_torque"]
    return {
        "": efficiency,
        "columns": 1.0 / efficiency,
        "torques": ratio**2 / efficiency,
        "speeds": efficiency / ratio**2,
    }


def plausible_exchange(values: Mapping[str, Array]) -> str:
    """Return what was exchanged between the shafts if most efficiencies are impossible.

    Args:
        values: SI values by quantity, shape (n,) each.

    Returns:
        `columns` (speed and torque), `torques` or `speeds`; `""` where no exchange makes the
        efficiencies plausible.
    """
    efficiencies = _efficiencies_if_exchanged(values)
    given = efficiencies.pop("", None)
    if given is None or _are_plausible(given):
        return ""
    for exchange, efficiency in efficiencies.items():
        if _are_plausible(efficiency):
            return exchange
    return ""


def _steadier_exchange(values: Mapping[str, Array]) -> str:
    """Return `torques` or `speeds` where their exchange makes the efficiencies steadier."""
    efficiencies = _efficiencies_if_exchanged(values)
    for exchange in ("torques", "speeds"):
        if exchange not in efficiencies or not _are_plausible(efficiencies[exchange]):
            continue
        given = efficiencies[""]
        if np.all(given > 0.0):
            spread = np.std(np.log(given))
            if np.std(np.log(efficiencies[exchange])) < _BETTER * spread:
                return exchange
    return ""


def _are_plausible(efficiency: Array) -> bool:
    """Return whether most efficiencies are those of a transmission at work."""
    low, high = _PLAUSIBLE
    inside = (efficiency > low) & (efficiency < high)
    return bool(len(inside)) and float(inside.mean()) >= _MOST


def _inverse_line(
    stroke: Array, ratio: Array, columns: Mapping[str, Column], stage: str
) -> list[str]:
    """Return the question of speeds whose inverse ratio is linear in the stroke.

    Args:
        stroke: displacement ratio of the tests of one stage, shape (n,) [-].
        ratio: output speed / engine speed at them, shape (n,) [-].
        columns: where the quantities stand.
        stage: its name; `""` where no column names it.
    """
    known = np.isfinite(stroke) & np.isfinite(ratio)
    stroke = stroke[known]
    ratio = ratio[known]
    if len(stroke) < _FEWEST_OF_SLOPE or np.ptp(stroke) < _MIN_STROKES:
        return []
    engine = columns["engine_speed"]
    output = columns["output_speed"]
    first = option("engine_speed", engine.name, engine.unit)
    second = option("output_speed", output.name, output.unit)
    remedy = f"add {first} {second} if they are right"
    if len(stroke) < _FEWEST_OF_LINE:
        slope, _ = np.polyfit(stroke, ratio, 1)
        if stage or slope >= 0.0:
            return []
        return [
            f"output speed / engine speed falls as the stroke rises, and {len(stroke)} tests do "
            f"not show whether the two speeds are exchanged; {remedy}"
        ]
    forward = _distance_from_line(stroke, ratio)
    inverse = _distance_from_line(stroke, 1.0 / ratio)
    if forward < _MIN_CURVATURE or inverse > _BETTER * forward:
        return []
    of_stage = f" of stage {stage}" if stage else ""
    return [
        f"engine speed / output speed{of_stage} is a line over the stroke and output speed / "
        "engine speed is none: the two speeds are exchanged, or the stage is output-coupled; "
        f"{remedy}"
    ]


def _distance_from_line(stroke: Array, ratio: Array) -> float:
    """Return the deviation from the straight line through points, as a part of their mean."""
    line = np.polyval(np.polyfit(stroke, ratio, 1), stroke)
    return float(np.std(ratio - line) / np.mean(ratio))


@np.errstate(divide="ignore", invalid="ignore")  # a shaft may stand
def odd_ratios(
    values: Mapping[str, Array], stages: Sequence[str] | None = None
) -> dict[int, str]:
    """Return the few tests whose speed ratio does not fit their stroke, by position.

    Args:
        values: SI values by quantity, shape (n,) each; NaN where nothing is known.
        stages: of the tests; None where no column names them.
    """
    ratio = _speed_ratio(values)
    if ratio is None:
        return {}
    reasons = {}
    for stage, tests in tests_by_stage(stages, len(ratio)).items():
        stroke = values["displacement_ratio"][tests]
        for position, reason in _odd_in_stage(stroke, ratio[tests], stage).items():
            reasons[int(tests[position])] = reason
    return reasons


def _odd_in_stage(stroke: Array, ratio: Array, stage: str) -> dict[int, str]:
    """Return the odd tests of one stage, by position among them."""
    known = np.flatnonzero(np.isfinite(ratio) & np.isfinite(stroke) & (ratio > 0.0))
    if len(known) < _FEWEST_FOR_ODD or np.ptp(stroke[known]) == 0.0:
        return {}
    line = _line_of_most(stroke[known], ratio[known])
    inverse = 1.0 / _line_of_most(stroke[known], 1.0 / ratio[known])
    apart = np.abs(ratio[known] / line - 1.0)
    apart_inverse = np.abs(ratio[known] / inverse - 1.0)
    if np.median(apart_inverse) < np.median(apart):
        line = inverse
        apart = apart_inverse
    deviation = max(1.4826 * float(np.median(apart)), _MIN_DEVIATION)
    odd = np.flatnonzero(apart > _ODD_DEVIATIONS * deviation)
    if len(odd) > min(_MAX_ODD, max(1.0, _MAX_ODD_SHARE * len(known))):
        return {}
    others = f"the other tests of {stage}" if stage else "the other tests"
    reasons = {}
    for position in odd.tolist():
        index = int(known[position])
        reasons[index] = (
            f"output speed / engine speed = {ratio[index]:.4g} does not fit its stroke, at "
            f"which {others} give {line[position]:.4g}"
        )
    return reasons


def _line_of_most(stroke: Array, ratio: Array) -> Array:
    """Return the straight line through most points, at their strokes."""
    order = np.argsort(stroke, kind="stable")
    half = len(order) // 2
    low = order[:half]
    high = order[len(order) - half :]
    run = stroke[high] - stroke[low]
    usable = run > 0.0
    slope = 0.0
    if usable.any():
        slope = float(np.median((ratio[high] - ratio[low])[usable] / run[usable]))
    return np.asarray(float(np.median(ratio - slope * stroke)) + slope * stroke)


def odd_oil(values: Mapping[str, Array]) -> dict[int, str]:
    """Return tests with an oil at 0 deg C or less among warm ones, by position."""
    oil = values.get("oil_temperature")
    if oil is None or not np.isfinite(oil).any():
        return {}
    middle = float(np.nanmedian(oil))
    if middle < _COLD:
        return {}
    reasons = {}
    for index in np.flatnonzero(oil <= 0.0).tolist():
        reasons[index] = (
            f"oil_temperature = {oil[index]:.4g} deg C among tests at {middle:.4g} deg C is "
            "a code for no value"
        )
    return reasons


def shafts_note(
    values: Mapping[str, Array],
    columns: Mapping[str, Column],
    stages: Sequence[str] | None = None,
) -> str:
    """Say which columns were taken for which shaft, and what speed ratio they give.

    Args:
        values: SI values of the samples, shape (n,) each.
        columns: where they stand.
        stages: of the samples; None where no column names them.
    """
    sides = []
    for side in ("engine", "output"):
        names = []
        for kind in ("speed", "torque", "power"):
            column = columns.get(f"{side}_{kind}")
            if column is not None:
                names.append(f"{kind} {column.name!r}")
        if names:
            sides.append(f"{side} shaft: {', '.join(names)}")
    ratio = _speed_ratio(values)
    if len(sides) < 2 or ratio is None:
        return ""
    ratios = []
    for stage, tests in tests_by_stage(stages, len(ratio)).items():
        stroke = values["displacement_ratio"][tests]
        in_stage = f"in {stage} " if stage else ""
        ratios.append(in_stage + _ratio_at_ends(stroke, ratio[tests]))
    return f"{'; '.join(sides)}; output speed / engine speed is {'; '.join(sorted(ratios))}"


def _ratio_at_ends(stroke: Array, ratio: Array) -> str:
    """Say the speed ratio at the ends of the stroke of one stage."""
    lowest = int(np.argmin(stroke))
    highest = int(np.argmax(stroke))
    text = f"{ratio[lowest]:.3g} at stroke {stroke[lowest]:.2g}"
    if stroke[highest] > stroke[lowest]:
        text += f" and {ratio[highest]:.3g} at {stroke[highest]:.2g}"
        if ratio[highest] < ratio[lowest]:
            text += f"{FALLS}{DOUBT}"
    return text
