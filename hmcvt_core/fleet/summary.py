# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The table over a fleet, and which of its transmissions stand apart."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..diagnosis.results.outcome import NAMING
from ..transmission.parameters import PARAMETER_NAMES, PARAMETER_UNITS

Entry = dict[str, Any]
"""A log: `record` of a finished one, `log` and `error` (why, in one line) of a broken one."""

THRESHOLD = 3.5
LEAST_LOGS = 8
"""Below as many values a median absolute deviation is itself a matter of chance."""

GAP = "gap"
_LOGARITHMIC = ("leakage",)
_MAD_TO_DEVIATION = 1.4826
_LEAST_DEVIATION = 1e-6  # of the largest value: less is rounding, not scatter


class Scores(NamedTuple):
    """Where n values stand: `deviation` is 1.4826 MAD, of logarithms in decades."""

    median: float
    deviation: float
    z: NDArray[np.float64]


def robust_scores(values: Sequence[float], logarithmic: bool = False) -> Scores:
    """Compare values with their median, to tell which transmissions stand apart from their fleet.

    .. math:: z = (x - median) / (1.4826 MAD)

    1.4826 makes the median absolute deviation that of a normal distribution. |z| > 3.5 counts as an
    outlier (Iglewicz and Hoaglin, How to Detect and Handle Outliers, 1993). Median and MAD hold
    while less than half of the fleet is odd; mean and standard deviation would follow the odd ones.

    Args:
        values: n finite numbers, at least one; positive with `logarithmic`.
        logarithmic: for a quantity that spans decades: compare the logarithms (base 10).

    Returns:
        `z` is NaN for all when the values are too few or at least half of them equal.
    """
    x = np.log10(values) if logarithmic else np.asarray(values, dtype=float)
    median = float(np.median(x))
    deviation = _MAD_TO_DEVIATION * float(np.median(np.abs(x - median)))
    enough = len(x) >= LEAST_LOGS and deviation > _LEAST_DEVIATION * float(
        np.abs(x).max()
    )
    z = (x - median) / deviation if enough else np.full(len(x), np.nan)
    return Scores(10.0**median if logarithmic else median, deviation, z)


def record(result: Mapping[str, Any]) -> Entry:
    """Return what the table shows of a log, from its result.

    `gap` is the error of prediction, rms [-]; what the diagnosis does not tell is None.
    """
    parameters, found = result["identification"]["parameters"], result["diagnosis"]
    named = found is not None and found["verdict"] in NAMING
    return {
        "log": result["log"],
        "parameters": {
            name: {
                key: parameters[name][key]
                for key in ("value", "unit", "standard_error")
            }
            for name in PARAMETER_NAMES
        },
        GAP: None if found is None else found["gap"]["rmse"],
        "verdict": None if found is None else found["verdict"],
        "cause": found["causes"][0]["effect"] if named else None,
        "probability": found["causes"][0]["probability"] if named else None,
    }


def summarise(before: Sequence[Entry], now: Sequence[Entry]) -> dict[str, Any]:
    """Return the fleet as plain data for JSON.

    Args:
        before: logs finished by an earlier run.
        now: logs of this run.
    """
    every = sorted([*before, *now], key=itemgetter("log"))
    rows, broken = (
        [entry for entry in every if ("error" in entry) == failed]
        for failed in (False, True)
    )
    values = {
        name: [row["parameters"][name]["value"] for row in rows]
        for name in PARAMETER_NAMES
    }
    values[GAP] = [row[GAP] for row in rows if row[GAP] is not None]
    scores = {
        name: robust_scores(column, name in _LOGARITHMIC)
        for name, column in values.items()
        if column
    }
    logs = []
    for place, row in enumerate(rows):
        z = {name: float(found.z[place]) for name, found in scores.items()}
        logs.append(
            {
                **row,
                "z": z,
                "outlier": [name for name, far in z.items() if abs(far) > THRESHOLD],
            }
        )
    return {
        "counts": {
            "logs": len(every),
            "finished_now": len(rows) - len(before),
            "finished_before": len(before),
            "broken": len(broken),
            "outliers": sum(bool(log["outlier"]) for log in logs),
            "verdicts": _counted(row["verdict"] for row in rows),
            "causes": _counted(row["cause"] for row in rows),
        },
        "outlier_rule": {
            "z": "(value - median) / deviation; deviation = 1.4826 x median absolute deviation",
            "threshold": THRESHOLD,
            "least_logs": LEAST_LOGS,
        },
        "fleet": {
            name: {
                "unit": PARAMETER_UNITS.get(name, "-"),
                "median": found.median,
                "deviation": found.deviation,
                "scale": "log10" if name in _LOGARITHMIC else "linear",
                "judged": bool(np.isfinite(found.z).all()),
            }
            for name, found in scores.items()
        },
        "logs": logs,
        "broken": broken,
    }


def _counted(words: Iterable[str | None]) -> dict[str, int]:
    return dict(Counter(word for word in words if word is not None).most_common())
