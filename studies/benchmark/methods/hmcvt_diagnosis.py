# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""hmcvt as a method of the benchmark."""

import numpy as np

import hmcvt_core as hmcvt
from studies.benchmark.answer import Answer
from studies.benchmark.case import Case

VERDICTS = {"no_gap": "no_gap", "unexplained": "unlisted", "excess_scatter": "unlisted"}


def answer(case: Case) -> Answer:
    """Diagnose the bench file of a case."""
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
