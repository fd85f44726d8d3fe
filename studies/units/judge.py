# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What is found on one unit, real or simulated."""

import csv
from pathlib import Path
from typing import Any

import numpy as np

from hmcvt_core.benches.unit import DEALS, UnitDiagnosis, diagnose_unit
from hmcvt_core.benches.unit.samples import KINDS, UnitSamples
from hmcvt_tools.tables.unit_table import read_unit

from .simulate import simulated

BAND = 0.7


def units_in(folder: Path) -> dict[str, UnitSamples]:
    """Read every unit of every CSV file of a folder; see `units_of`."""
    units = {}
    for path in sorted(folder.glob("*.csv")):
        units.update(units_of(path))
    return units


def units_of(path: Path) -> dict[str, UnitSamples]:
    """Read every unit of a CSV file; its name gives the kind where no column does."""
    lines = path.read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    kind = None
    if "kind" not in rows[0]:
        kind = next(kind for kind in KINDS if path.name.startswith(kind))
    units = {}
    for name in dict.fromkeys(row.get("unit", path.stem) for row in rows):
        unit = name if "unit" in rows[0] else None
        units[f"{name} ({kind})"] = read_unit(path, kind=kind, unit=unit)
    return units


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
    same = "" if one.same is None else f" ({one.same} of {DEALS} fold assignments)"
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
