# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The table over a fleet, and which of its transmissions are outliers."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.diagnosis.results.outcome import NAMING
from hmcvt_core.transmission.parameters import PARAMETER_NAMES, PARAMETER_UNITS

Entry = dict[str, Any]
"""A log: `record` of a finished one, `log` and `error` (why, in one line) of a broken one."""

THRESHOLD = 3.5
"""|z| of an outlier (Iglewicz and Hoaglin, How to Detect and Handle Outliers, 1993)."""

MIN_LOGS = 8
"""Of fewer values a median absolute deviation is itself a matter of chance."""

GAP = "gap"
_LOGARITHMIC = ("leakage",)
_MAD_TO_DEVIATION = 1.4826  # of a normal distribution
_MIN_DEVIATION = 1e-6  # of the largest value: less is rounding, not scatter


class Scores(NamedTuple):
    """Robust scores of n values.

    Attributes:
        median: of the values.
        deviation: 1.4826 MAD, of logarithms in decades.
        z: (value - median) / deviation, shape (n,).
    """

    median: float
    deviation: float
    z: NDArray[np.float64]


def robust_scores(values: Sequence[float], logarithmic: bool = False) -> Scores:
    """Compare values with their median, to find outliers of a fleet.

    .. math:: z = (x - median) / (1.4826 MAD)

    1.4826 makes the median absolute deviation that of a normal distribution. Median and MAD hold
    while less than half of the fleet is odd; mean and standard deviation would follow the odd ones.

    Args:
        values: n finite numbers, at least one; positive with `logarithmic`.
        logarithmic: for a quantity that spans decades: compare the logarithms (base 10).

    Returns:
        `z` is NaN for all when the values are too few or at least half of them equal.
    """
    x = np.asarray(values, dtype=float)
    if logarithmic:
        x = np.log10(x)
    median = float(np.median(x))
    deviation = _MAD_TO_DEVIATION * float(np.median(np.abs(x - median)))
    least = _MIN_DEVIATION * float(np.abs(x).max())
    z = np.full(len(x), np.nan)
    if len(x) >= MIN_LOGS and deviation > least:
        z = (x - median) / deviation
    if logarithmic:
        median = 10.0**median
    return Scores(median, deviation, z)


def record(result: Mapping[str, Any]) -> Entry:
    """Return what the table shows of a log, from its result.

    `gap` is the error of prediction, rms [-]; what the diagnosis does not state is None.
    """
    identified = result["identification"]["parameters"]
    parameters = {}
    for name in PARAMETER_NAMES:
        entry = identified[name]
        parameters[name] = {
            key: entry[key] for key in ("value", "unit", "standard_error")
        }
    row: Entry = {
        "log": result["log"],
        "parameters": parameters,
        GAP: None,
        "verdict": None,
        "cause": None,
        "probability": None,
    }
    diagnosis = result["diagnosis"]
    if diagnosis is None:
        return row
    row[GAP] = diagnosis["gap"]["rmse"]
    row["verdict"] = diagnosis["verdict"]
    if diagnosis["verdict"] in NAMING:
        leading = diagnosis["causes"][0]
        row["cause"] = leading["effect"]
        row["probability"] = leading["probability"]
    return row


def summarise(before: Sequence[Entry], now: Sequence[Entry]) -> dict[str, Any]:
    """Return the fleet as plain data for JSON.

    Args:
        before: logs finished by an earlier run.
        now: logs of this run.
    """
    rows = []
    broken = []
    for entry in sorted([*before, *now], key=itemgetter("log")):
        if "error" in entry:
            broken.append(entry)
        else:
            rows.append(entry)
    scores = _scores(rows)
    logs = _with_scores(rows, scores)
    outliers = [log for log in logs if log["outlier"]]
    return {
        "counts": {
            "logs": len(rows) + len(broken),
            "finished_now": len(rows) - len(before),
            "finished_before": len(before),
            "broken": len(broken),
            "outliers": len(outliers),
            "verdicts": _counted(row["verdict"] for row in rows),
            "causes": _counted(row["cause"] for row in rows),
        },
        "outlier_rule": {
            "z": "(value - median) / deviation; deviation = 1.4826 x median absolute deviation",
            "threshold": THRESHOLD,
            "least_logs": MIN_LOGS,
        },
        "fleet": {name: _quantity(name, entry) for name, entry in scores.items()},
        "logs": logs,
        "broken": broken,
    }


def _scores(rows: Sequence[Entry]) -> dict[str, Scores]:
    """Return the scores of each quantity that the logs state."""
    if not rows:
        return {}
    scores = {}
    for name in PARAMETER_NAMES:
        values = [row["parameters"][name]["value"] for row in rows]
        scores[name] = robust_scores(values, name in _LOGARITHMIC)
    gaps = [row[GAP] for row in rows if row[GAP] is not None]
    if gaps:
        scores[GAP] = robust_scores(gaps)
    return scores


def _with_scores(
    rows: Sequence[Entry], scores: Mapping[str, Scores]
) -> list[dict[str, Any]]:
    """Return the rows with their z scores and the quantities in which they are outliers."""
    logs = []
    for i, row in enumerate(rows):
        z = {name: float(entry.z[i]) for name, entry in scores.items()}
        outlier = [name for name, value in z.items() if abs(value) > THRESHOLD]
        logs.append({**row, "z": z, "outlier": outlier})
    return logs


def _quantity(name: str, scores: Scores) -> dict[str, Any]:
    return {
        "unit": PARAMETER_UNITS.get(name, "-"),
        "median": scores.median,
        "deviation": scores.deviation,
        "scale": "log10" if name in _LOGARITHMIC else "linear",
        "judged": bool(np.isfinite(scores.z).all()),
    }


def _counted(words: Iterable[str | None]) -> dict[str, int]:
    """Return how often each word occurs, the most frequent first."""
    counter = Counter(word for word in words if word is not None)
    return dict(counter.most_common())
