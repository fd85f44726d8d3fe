# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""hmcvt as a method of the benchmark."""

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.benches.unit import UnitChange, diagnose_unit
from hmcvt_core.benches.unit.system import points_of
from studies.benchmark.answer import Answer
from studies.benchmark.case import Case, read_columns
from studies.benchmark.rig import ideal_flow, samples_of

VERDICTS = {"no_gap": "no_gap", "unexplained": "unlisted", "excess_scatter": "unlisted"}


def answer(case: Case) -> Answer:
    """Diagnose the bench file of a case, against its baseline where there is one."""
    if (case.folder / "baseline.csv").is_file():
        return against_baseline(case)
    model = hmcvt.load_model(case.folder / "stage.yaml")
    found = hmcvt.diagnose(model, hmcvt.read_bench(case.folder / "bench.csv"))
    points = case.points
    axes = ("displacement_ratio", "engine_speed", "load_torque", "oil_temperature")
    at = {axis: points[axis] for axis in axes if axis in points}
    named = dict(at)
    if len(model.stages) > 1:
        at["stage"] = points["stage"]
        if len(set(case.tests["stage"])) > 1:
            order = list(model.stages)
            named["stage"] = np.array([order.index(n) for n in points["stage"]], float)
    base = case.model_at_points.base
    gap, deviation = found.gap_at(**named)
    # The gap is asked against the base of the case, not against that of the diagnosis.
    gap = np.nan_to_num(gap + found.base.efficiency(**at) - base)
    prediction = np.nan_to_num(found.model.efficiency(**at), nan=0.0)
    forms = {cause.effect: cause.form for cause in found.causes}
    no_gap = float(found.advice.no_gap)
    sets = []
    for item in found.sets:
        names = tuple(f"{n}:{forms[n]}" if forms.get(n) else n for n in item.effects)
        sets.append((names, (1.0 - no_gap) * item.probability))
    return Answer(
        case=case.name,
        method="hmcvt",
        verdict=VERDICTS.get(found.verdict, "listed") if sets else "no_gap",
        sets=tuple(sets),
        no_gap_probability=no_gap,
        unlisted_probability=(1.0 - no_gap) * found.unlisted,
        part=found.causes[0].component if found.causes else None,
        promised=found.shrinkage.fraction,
        gap=tuple(gap.tolist()),
        gap_deviation=tuple(np.nan_to_num(deviation).tolist()),
        prediction=tuple(prediction.tolist()),
    )


def against_baseline(case: Case) -> Answer:
    """Diagnose what has changed in a pump since its baseline."""
    displacement = case.card["machine"]["displacement"]
    sound = samples_of(read_columns(case.folder / "baseline.csv"), displacement)
    change = diagnose_unit(samples_of(case.tests, displacement), baseline=sound)
    assert isinstance(change, UnitChange)
    found = change.diagnosis
    points = samples_of(case.points, displacement)
    ideal = ideal_flow(points)
    prediction = 1.0 - change.model.predict(points)["flow_loss"] / ideal
    gap, deviation = found.gap_at(**points_of(points))
    no_gap = float(found.advice.no_gap)
    sets = tuple(
        (item.effects, (1.0 - no_gap) * item.probability) for item in found.sets
    )
    return Answer(
        case=case.name,
        method="hmcvt",
        verdict=VERDICTS.get(found.verdict, "listed") if sets else "no_gap",
        sets=sets,
        no_gap_probability=no_gap,
        unlisted_probability=(1.0 - no_gap) * found.unlisted,
        part=change.component,
        promised=found.shrinkage.fraction,
        gap=tuple((-gap / ideal).tolist()),
        gap_deviation=tuple((deviation / ideal).tolist()),
        prediction=tuple(prediction.tolist()),
    )
