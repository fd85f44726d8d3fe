# SPDX-License-Identifier: Apache-2.0
"""The table over the fleet: one row per log, robust z scores, counts.

A z score tells which transmissions stand apart from their fleet:

.. math:: z = (x - median) / (1.4826 MAD)

1.4826 makes the median absolute deviation that of a normal distribution. |z| > 3.5 counts as an
outlier (Iglewicz and Hoaglin, How to Detect and Handle Outliers, 1993). Median and MAD hold while
less than half of the fleet is odd; mean and standard deviation would follow the odd ones.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..transmission.parameters import PARAMETER_NAMES, PARAMETER_UNITS

Array = NDArray[np.float64]

THRESHOLD = 3.5
LEAST_LOGS = 8
"""Below as many values a median absolute deviation is itself a matter of chance."""

_MAD_TO_DEVIATION = 1.4826
_LEAST_DEVIATION = 1e-6  # of the largest value: less is rounding, not scatter

GAP = "gap"
QUANTITIES = {**PARAMETER_UNITS, GAP: "-"}
"""What is compared over the fleet, with its unit."""

_LOGARITHMIC = ("leakage",)
_NAMED = ("cause_found", "ambiguous")  # verdicts that name a cause


class Scores(NamedTuple):
    """Where each value stands.

    Attributes:
        median: of the values.
        deviation: 1.4826 MAD, in the unit of the values; in decades with `logarithmic`.
        logarithmic: whether the logarithms (base 10) were compared.
        z: shape (n,); NaN for all when the values are too few or at least half of them equal.
    """

    median: float
    deviation: float
    logarithmic: bool
    z: Array


def robust_scores(values: Sequence[float], logarithmic: bool = False) -> Scores:
    """Compare values with their median.

    Args:
        values: n finite numbers, at least one; positive with `logarithmic`.
        logarithmic: for a quantity that spans decades.
    """
    x = np.log10(values) if logarithmic else np.asarray(values, dtype=float)
    median = float(np.median(x))
    deviation = _MAD_TO_DEVIATION * float(np.median(np.abs(x - median)))
    enough = len(x) >= LEAST_LOGS and deviation > _LEAST_DEVIATION * float(np.abs(x).max())
    z = (x - median) / deviation if enough else np.full(len(x), np.nan)
    return Scores(10.0 ** median if logarithmic else median, deviation, logarithmic, z)


@dataclass(frozen=True)
class Row:
    """What the table shows of one log.

    Attributes:
        log: its name.
        values: parameters by name [SI], and `gap`: error of prediction, rms [-], if diagnosed.
        standard_errors: of the parameters.
        verdict: of the diagnosis, or None.
        cause: leading effect where the verdict names one, or None.
        probability: of the cause, or None.
    """

    log: str
    values: Mapping[str, float]
    standard_errors: Mapping[str, float]
    verdict: str | None = None
    cause: str | None = None
    probability: float | None = None

    @classmethod
    def of(cls, result: Mapping[str, Any]) -> Row:
        """Take a row from the result of a log."""
        parameters = result["identification"]["parameters"]
        values = {name: parameters[name]["value"] for name in PARAMETER_NAMES}
        errors = {name: parameters[name]["standard_error"] for name in PARAMETER_NAMES}
        found = result["diagnosis"]
        if found is None:
            return cls(result["log"], values, errors)
        values[GAP] = found["gap"]["rmse"]
        if found["verdict"] not in _NAMED:
            return cls(result["log"], values, errors, found["verdict"])
        cause = found["causes"][0]
        return cls(result["log"], values, errors, found["verdict"], cause["effect"],
                   cause["probability"])


@dataclass(frozen=True)
class BrokenLog:
    """A log without result, and why in one line."""

    log: str
    error: str


@dataclass(frozen=True)
class Summary:
    """A fleet.

    Attributes:
        rows: finished logs by name.
        broken: logs without result by name.
        before: how many of `rows` were finished by an earlier run.
        scores: by quantity, in the order of `rows`; quantities that no log has are left out.
    """

    rows: tuple[Row, ...]
    broken: tuple[BrokenLog, ...]
    before: int
    scores: Mapping[str, Scores]

    @classmethod
    def of(cls, done: Iterable[Row], entries: Iterable[Row | BrokenLog]) -> Summary:
        """Put together rows of an earlier run and entries of this one."""
        earlier, entries = list(done), list(entries)
        rows = earlier + [entry for entry in entries if isinstance(entry, Row)]
        rows.sort(key=lambda row: row.log)
        broken = [entry for entry in entries if isinstance(entry, BrokenLog)]
        broken.sort(key=lambda entry: entry.log)
        # The settings decide what a row holds: all of them hold the same.
        names = [name for name in QUANTITIES if rows and name in rows[0].values]
        scores = {name: robust_scores([row.values[name] for row in rows], name in _LOGARITHMIC)
                  for name in names}
        return cls(tuple(rows), tuple(broken), len(earlier), scores)

    def outlying(self, place: int) -> dict[str, float]:
        """Return z by quantity where the row at `place` is an outlier."""
        found = {name: float(scores.z[place]) for name, scores in self.scores.items()}
        return {name: z for name, z in found.items() if abs(z) > THRESHOLD}

    def counts(self) -> dict[str, Any]:
        """Return how many logs there are of each kind."""
        outliers = sum(bool(self.outlying(place)) for place in range(len(self.rows)))
        return {
            "logs": len(self.rows) + len(self.broken), "finished_now": len(self.rows) - self.before,
            "finished_before": self.before, "broken": len(self.broken), "outliers": outliers,
            "verdicts": _counted(row.verdict for row in self.rows),
            "causes": _counted(row.cause for row in self.rows)}

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {
            "counts": self.counts(),
            "outlier_rule": {
                "z": "(value - median) / deviation; deviation = 1.4826 x median absolute deviation",
                "threshold": THRESHOLD, "least_logs": LEAST_LOGS},
            "fleet": {name: {"unit": QUANTITIES[name], "median": scores.median,
                             "deviation": scores.deviation,
                             "scale": "log10" if scores.logarithmic else "linear",
                             "judged": bool(np.isfinite(scores.z).all())}
                      for name, scores in self.scores.items()},
            "logs": [self._record(place, row) for place, row in enumerate(self.rows)],
            "broken": [{"log": entry.log, "error": entry.error} for entry in self.broken]}

    def _record(self, place: int, row: Row) -> dict[str, Any]:
        return {
            "log": row.log,
            "parameters": {name: {"value": row.values[name], "unit": PARAMETER_UNITS[name],
                                  "standard_error": row.standard_errors[name]}
                           for name in PARAMETER_NAMES},
            "gap": row.values.get(GAP), "verdict": row.verdict, "cause": row.cause,
            "probability": row.probability,
            "z": {name: float(scores.z[place]) for name, scores in self.scores.items()},
            "outlier": list(self.outlying(place))}


def _counted(words: Iterable[str | None]) -> dict[str, int]:
    return dict(Counter(word for word in words if word is not None).most_common())
