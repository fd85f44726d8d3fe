# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What is found on one unit, real or simulated."""

import csv
from pathlib import Path
from typing import Any

import numpy as np

from hmcvt_core.benches.unit import DEALS, UnitDiagnosis, diagnose_unit
from hmcvt_core.files.units import KINDS, UnitSamples, read_unit

from .simulate import simulated

BAND = 0.7


def units_in(folder: Path) -> dict[str, UnitSamples]:
    """Read every unit of every CSV file; a name of the file tells the kind where no column does."""
    found = {}
    for path in sorted(folder.glob("*.csv")):
        lines = [
            line for line in path.read_text().splitlines() if not line.startswith("#")
        ]
        rows = list(csv.DictReader(lines))
        for name in dict.fromkeys(row.get("unit", path.stem) for row in rows):
            kind = (
                None
                if "kind" in rows[0]
                else next(kind for kind in KINDS if path.name.startswith(kind))
            )
            found[f"{name} ({kind})"] = read_unit(
                path, kind=kind, unit=name if "unit" in rows[0] else None
            )
    return found


def judged(samples: UnitSamples) -> dict[str, Any]:
    """Diagnose a unit as a whole, and fitted below a part of the highest pressure and speed."""
    return {
        "whole": record(diagnose_unit(samples)),
        **{
            axis: record(diagnose_unit(*samples.divided(axis, BAND)))
            for axis in ("pressure", "speed")
        },
    }


def record(one: UnitDiagnosis) -> dict[str, Any]:
    """What the page says of one diagnosis: errors in L/min and N m, and how much is removed."""
    found, errors = one.diagnosis, {}
    for channel, factor in (("flow", 6e4), ("torque", 1.0)):
        row = {
            name: np.nan if value is None else factor * value
            for name, value in one.rmse[channel].items()
        }
        part = 1.0 - (row["holdout_with_effects"] / row["holdout_base"]) ** 2
        errors[channel] = {**row, "removed": part}
    same = "" if one.same is None else f" ({one.same} of {DEALS} deals)"
    return {
        "samples": len(found.samples),
        "verdict": found.verdict.replace("_", " ") + same,
        "effects": found.sets[0].effects if found.sets else (),
        "errors": errors,
        "warnings": found.warnings,
    }


def tried(
    task: tuple[tuple[str, ...], int],
) -> tuple[tuple[str, ...], str, tuple[str, ...]]:
    """Diagnose a simulated unit: what it has, the verdict, and which set leads."""
    names, seed = task
    found = diagnose_unit(simulated(names, seed), deals=False).diagnosis
    return names, found.verdict, found.sets[0].effects if found.sets else ()
