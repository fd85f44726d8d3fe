# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The answer of one method to one case: the JSON file that any tool can write."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

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


def read_answer(path: Path, points: int) -> Answer:
    """Read an answer file.

    Args:
        path: of the file.
        points: number of points of the case.

    Raises:
        ValueError: the file is not an answer; file and field are named.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: not JSON: {error}") from error
    if not isinstance(data, dict):
        raise ValueError(f"{path}: holds {type(data).__name__}, must be an object")
    if data.get("format") != FORMAT:
        raise ValueError(f"{path}: format = {data.get('format')!r}, must be {FORMAT!r}")
    if data.get("verdict") not in VERDICTS:
        raise ValueError(
            f"{path}: verdict = {data.get('verdict')!r}, must be one of {VERDICTS}"
        )
    sets = _sets(path, data.get("sets"))
    no_gap = _number(path, data, "no_gap_probability", 0.0, 1.0)
    unlisted = _number(path, data, "unlisted_probability", 0.0, 1.0)
    total = no_gap + unlisted + sum(probability for _, probability in sets)
    if total > 1.0 + _ROUNDING:
        raise ValueError(f"{path}: probabilities sum to {total:.6g}, must be at most 1")
    if data["verdict"] == "listed" and not sets:
        raise ValueError(f"{path}: verdict is listed, but sets is empty")
    promised = None
    if data.get("promised") is not None:
        promised = _number(path, data, "promised", -np.inf, 1.0)
    return Answer(
        case=str(data.get("case")),
        method=str(data.get("method")),
        verdict=data["verdict"],
        sets=sets,
        no_gap_probability=no_gap,
        unlisted_probability=unlisted,
        part=data.get("part"),
        promised=promised,
        gap=_array(path, data, "gap", points),
        gap_deviation=_array(path, data, "gap_deviation", points, low=0.0),
        prediction=_array(path, data, "prediction", points),
        seconds=float(data.get("seconds", 0.0)),
    )


def _sets(path: Path, value: Any) -> tuple[tuple[tuple[str, ...], float], ...]:
    if not isinstance(value, list):
        raise ValueError(f"{path}: sets = {value!r}, must be a list")
    sets = []
    for number, item in enumerate(value, 1):
        if not isinstance(item, dict) or not item.get("effects"):
            raise ValueError(f"{path}: sets[{number}] has no effects")
        probability = _number(
            path, item, "probability", 0.0, 1.0, f"sets[{number}].probability"
        )
        sets.append((tuple(map(str, item["effects"])), probability))
    ranked = [probability for _, probability in sets]
    if ranked != sorted(ranked, reverse=True):
        raise ValueError(f"{path}: sets are not in the order of their probability")
    return tuple(sets)


def _number(
    path: Path, data: Any, name: str, low: float, high: float, label: str = ""
) -> float:
    value = data.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{path}: {label or name} = {value!r}, must be a number")
    if not low <= value <= high + _ROUNDING:
        raise ValueError(
            f"{path}: {label or name} = {value!r}, must be {low:g} to {high:g}"
        )
    return float(value)


def _array(
    path: Path, data: Any, name: str, points: int, low: float = -np.inf
) -> tuple[float, ...]:
    values: Sequence[float] = data.get(name) or ()
    if len(values) != points:
        raise ValueError(
            f"{path}: {name} has {len(values)} values, must have {points}, one a point"
        )
    for number, value in enumerate(values, 1):
        numeric = isinstance(value, int | float) and not isinstance(value, bool)
        if not numeric or not np.isfinite(value) or value < low:
            raise ValueError(
                f"{path}: {name}[{number}] = {value!r}, must be a number"
                + (f" of at least {low:g}" if np.isfinite(low) else "")
            )
    return tuple(map(float, values))
