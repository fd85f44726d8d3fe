# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""One campaign: a worn unit, its samples with and without bad ones, and both refits."""

from dataclasses import dataclass, replace

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.identification.annealing import QUICK
from hmcvt_core.identification.refit import refit

WEAR = (2.0, 1.5, 1.5)  # highest factors of leakage and dampings
ERRORS = (0.05, 0.30)  # of a bad reading, of either sign


@dataclass(frozen=True)
class Case:
    """Conditions of a campaign.

    Attributes:
        what: them in words.
        noise: of the readings, relative.
        known: samples behind the model in service; 0 for `params/hm4.yaml`, which has five.
        bad: fewest and most bad samples.
        stated: whether the model in service states its errors.
    """

    what: str
    noise: float = 0.004
    known: int = 96
    bad: tuple[int, int] = (1, 3)
    stated: bool = True


def campaign(task: tuple[Case, int]) -> dict[str, float | bool]:
    """Largest errors over the domain [-], of what serves after each refit."""
    case, seed = task
    rng = np.random.default_rng(seed)
    served = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    if case.known:
        served = hmcvt.identify(
            bench(served, rng, case.known, case.noise),
            schedule=QUICK,
            stage=served.stage,
        ).model
    if not case.stated:
        served = replace(served, standard_errors={}, correlation=None)
    factors = rng.uniform(1.0, WEAR)
    worn = replace(
        served,
        parameters=hmcvt.HydraulicParameters(
            *(served.parameters.to_array() * factors).tolist()
        ),
    )
    samples = bench(worn, rng, int(rng.integers(20, 61)), case.noise)
    bad = rng.choice(
        len(samples), rng.integers(*case.bad, endpoint=True), replace=False
    )
    readings = samples.efficiency.copy()
    readings[bad] += rng.choice([-1.0, 1.0], len(bad)) * rng.uniform(*ERRORS, len(bad))
    good = np.setdiff1d(np.arange(len(samples)), bad)
    clean, spoiled = (
        refit(each, served, served)
        for each in (
            samples.select(good),
            replace(samples, efficiency=np.clip(readings, 0.01, 0.99)),
        )
    )
    domain = spoiled.model.domain
    assert domain is not None
    grid = np.meshgrid(
        *(np.linspace(low, high, 9) for low, high in domain.to_mapping().values())
    )
    truth = worn.efficiency(*grid)

    def error(model: hmcvt.EfficiencyModel) -> float:
        # Where the unit carries the load and the model says that it does not, nothing comes out.
        return float(np.nanmax(np.abs(np.nan_to_num(model.efficiency(*grid)) - truth)))

    serving = [
        error(served if each.refused else each.model) for each in (clean, spoiled)
    ]
    return {
        "served": error(served),
        "clean": serving[0],
        "spoiled": serving[1],
        "adopted": not clean.refused,
        "adopted_spoiled": not spoiled.refused,
        "found": float(np.isin(bad + 1, spoiled.set_aside).mean()),
        "blamed": float(np.isin(good + 1, spoiled.set_aside).sum()),
    }


def bench(
    unit: hmcvt.EfficiencyModel, rng: np.random.Generator, count: int, noise: float
) -> hmcvt.BenchSamples:
    """Measure a unit at random points of 18 to 60 kW that it can carry."""
    points = np.empty((3, 0))
    while points.shape[1] < count:
        speed = rng.uniform(80.0, 230.0)
        point = (
            rng.uniform(-1.0, 1.0),
            speed,
            np.clip(rng.uniform(18e3, 60e3) / speed, 40.0, 400.0),
        )
        if np.isfinite(unit.efficiency(*point)):
            points = np.column_stack([points, point])
    readings = unit.efficiency(*points) * (1.0 + noise * rng.standard_normal(count))
    return hmcvt.BenchSamples(
        points[0], points[1], points[2], np.clip(readings, 0.01, 0.99)
    )
