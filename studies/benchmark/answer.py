# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The answer of one method to one case: the JSON file that any tool can write."""

import json
import sys
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from studies.benchmark.case import Case, effects

FORMAT = "gap-benchmark-answer/1"
VERDICTS = ("no_gap", "listed", "unlisted")
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Answer:
    """Answer to one case.

    Attributes:
        case: name of the case.
        method: name of the method.
        verdict: `no_gap`; `listed`: the leading set explains the gap; `unlisted`: none does.
        sets: effects and probability of each set, most probable first. An effect is a name of
            effects.yaml, or `name:form`.
        no_gap_probability, unlisted_probability: with those of the sets, at most 1 in all.
        part: machine part in which the cause acts, or None.
        promised: fraction of the squared gap that the prediction removes, or None.
        gap: efficiency of the plant - base of model_points.csv at each point [-].
        gap_deviation: standard deviation of the gap at each point [-].
        prediction: efficiency at each point [-].
        seconds: processor time taken [s].
    """

    case: str
    method: str
    verdict: str
    sets: tuple[tuple[tuple[str, ...], float], ...]
    no_gap_probability: float
    unlisted_probability: float
    part: str | None
    promised: float | None
    gap: tuple[float, ...]
    gap_deviation: tuple[float, ...]
    prediction: tuple[float, ...]
    seconds: float = 0.0


def write_answer(path: Path, answer: Answer) -> None:
    """Write an answer file."""
    data = asdict(answer)
    data["format"] = FORMAT
    data["sets"] = [
        {"effects": list(effects), "probability": probability}
        for effects, probability in answer.sets
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")


def read_answer(path: Path, case: Case) -> Answer:
    """Read an answer file.

    Args:
        path: of the file, in a folder with the name of the method.
        case: that it answers.

    Raises:
        ValueError: the file is not an answer; file and field are named.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: not JSON: {error}") from error
    if not isinstance(data, dict):
        raise ValueError(f"{path}: holds {type(data).__name__}, must be an object")
    required = ("format", *(field.name for field in fields(Answer)))
    missing = [name for name in required if name not in data]
    if missing:
        raise ValueError(f"{path}: has no {', '.join(missing)}")
    parts = sorted({part for own in effects().values() for part in own["part"]})
    for name, allowed in (
        ("format", (FORMAT,)),
        ("case", (case.name,)),
        ("method", (path.parent.name,)),
        ("verdict", VERDICTS),
        ("part", (*parts, None)),
    ):
        if data[name] not in allowed:
            wanted = " or ".join(json.dumps(value) for value in allowed)
            raise ValueError(f"{path}: {name} = {data[name]!r}, must be {wanted}")
    sets = _sets(path, data["sets"], case)
    no_gap = _number(path, data, "no_gap_probability", 0.0, 1.0)
    unlisted = _number(path, data, "unlisted_probability", 0.0, 1.0)
    total = no_gap + unlisted + sum(probability for _, probability in sets)
    if total > 1.0 + _ROUNDING:
        raise ValueError(f"{path}: probabilities sum to {total:.6g}, must be at most 1")
    if data["verdict"] == "listed" and not sets:
        raise ValueError(f"{path}: verdict is listed, but sets is empty")
    promised = None
    if data["promised"] is not None:
        promised = _number(path, data, "promised", -np.inf, 1.0)
    points = len(case.model_at_points.base)
    return Answer(
        case=data["case"],
        method=data["method"],
        verdict=data["verdict"],
        sets=sets,
        no_gap_probability=no_gap,
        unlisted_probability=unlisted,
        part=data["part"],
        promised=promised,
        gap=_array(path, data, "gap", points),
        gap_deviation=_array(path, data, "gap_deviation", points, low=0.0),
        prediction=_array(path, data, "prediction", points),
        seconds=_number(path, data, "seconds", 0.0, np.inf),
    )


def _sets(
    path: Path, value: Any, case: Case
) -> tuple[tuple[tuple[str, ...], float], ...]:
    if not isinstance(value, list):
        raise ValueError(f"{path}: sets = {value!r}, must be a list")
    # A name with a typing error would count as another effect without a word.
    columns = case.model_at_points.names
    allowed = {*effects(), *(column.partition("/")[0] for column in columns)}
    sets = []
    for number, item in enumerate(value, 1):
        if not isinstance(item, dict) or not item.get("effects"):
            raise ValueError(f"{path}: sets[{number}] has no effects")
        names = item["effects"]
        if not isinstance(names, list):
            raise ValueError(
                f"{path}: sets[{number}].effects = {names!r}, must be a list"
            )
        for name in names:
            if name not in allowed:
                raise ValueError(
                    f"{path}: sets[{number}] names {name!r}, must be an effect of "
                    "effects.yaml, or name:form as in model_points.csv, without shape"
                )
        probability = _number(
            path, item, "probability", 0.0, 1.0, f"sets[{number}].probability"
        )
        sets.append((tuple(names), probability))
    ranked = [probability for _, probability in sets]
    if ranked != sorted(ranked, reverse=True):
        raise ValueError(f"{path}: sets are not in the order of their probability")
    return tuple(sets)


def _number(
    path: Path,
    data: dict[str, Any],
    name: str,
    low: float,
    high: float,
    label: str = "",
) -> float:
    value = data.get(name)
    if not _is_within(value, low, high):
        raise ValueError(
            f"{path}: {label or name} = {value!r}, must be {_wanted(low, high)}"
        )
    return float(value)


def _array(
    path: Path,
    data: dict[str, Any],
    name: str,
    points: int,
    low: float = -np.inf,
) -> tuple[float, ...]:
    values = data[name]
    if not isinstance(values, list):
        raise ValueError(
            f"{path}: {name} holds {type(values).__name__}, must be a list"
        )
    if len(values) != points:
        raise ValueError(
            f"{path}: {name} has {len(values)} values, must have {points}, one a point"
        )
    for number, value in enumerate(values, 1):
        if not _is_within(value, low, np.inf):
            raise ValueError(
                f"{path}: {name}[{number}] = {value!r}, must be {_wanted(low, np.inf)}"
            )
    return tuple(map(float, values))


def _is_within(value: Any, low: float, high: float) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    # Also false for NaN, infinity and an integer that no float holds.
    return abs(value) <= sys.float_info.max and low <= value <= high + _ROUNDING


def _wanted(low: float, high: float) -> str:
    limits = []
    if np.isfinite(low):
        limits.append(f"at least {low:g}")
    if np.isfinite(high):
        limits.append(f"at most {high:g}")
    if not limits:
        return "a finite number"
    return f"a finite number of {' and '.join(limits)}"
