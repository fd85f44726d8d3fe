# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Attacks on a refit: who controls some or all of the bench samples, and what they send.

Each attack takes the honest samples of a worn unit and returns the samples that the node has
logged. Where some readings are honest, a refit must not end worse than without the attack. Where
all are wrong in the same way, nothing shows it, and `MAX_CHANGE` is the bound.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.identification.annealing import QUICK
from hmcvt_core.identification.refit import MAX_CHANGE, Refit, refit
from hmcvt_core.interface import joined
from hmcvt_ros import jobs

from .campaign import bench

NOISE = 0.004
KNOWN = 96
"""Samples behind the model in service."""
_POINT = 0.01
"""Excess of an error that counts as harm [-]."""
_SIZE = np.array([1.0, 230.0, 400.0])
"""Range of displacement ratio [-], engine speed [rad/s] and load torque [N m]."""


@dataclass(frozen=True)
class Scene:
    """What an attack starts from.

    Attributes:
        rng: random numbers of the campaign.
        served: model in service, with stated errors.
        unit: unit on the bench, worn within `MAX_CHANGE`.
        honest: samples of that unit.
    """

    rng: np.random.Generator
    served: hmcvt.EfficiencyModel
    unit: hmcvt.EfficiencyModel
    honest: hmcvt.BenchSamples


@dataclass(frozen=True)
class Attack:
    """One kind of attack.

    Attributes:
        what: the attack in words.
        samples: returns the logged samples of a scene.
        all_wrong: whether every reading is wrong in the same way.
    """

    what: str
    samples: Callable[[Scene], hmcvt.BenchSamples]
    all_wrong: bool = False


def worn(model: hmcvt.EfficiencyModel, factors: np.ndarray) -> hmcvt.EfficiencyModel:
    """Return a model with its parameters multiplied."""
    values = model.parameters.to_array() * factors
    return replace(model, parameters=hmcvt.HydraulicParameters(*values.tolist()))


def shifted(samples: hmcvt.BenchSamples, by: np.ndarray) -> hmcvt.BenchSamples:
    """Return samples whose efficiencies read differently."""
    return replace(samples, efficiency=np.clip(samples.efficiency + by, 0.01, 0.99))


# --- attacks --------------------------------------------------------------------------------------


def _false_majority(scene: Scene) -> hmcvt.BenchSamples:
    """Honest samples and more of a machine that is not the one on the bench."""
    factors = scene.rng.uniform(0.5, [2.5, 2.0, 2.0])
    machine = worn(scene.served, factors)
    share = scene.rng.uniform(0.5, 0.95)
    count = max(round(share * len(scene.honest)), 1)
    false = bench(machine, scene.rng, count, NOISE)
    kept = scene.rng.permutation(len(scene.honest))[: len(scene.honest) - count]
    return _mixed(scene, scene.honest.select(np.sort(kept)), false)


def _false_majority_like_wear(scene: Scene) -> hmcvt.BenchSamples:
    """The same, with a machine that differs no more than wear explains."""
    machine = worn(scene.served, scene.rng.uniform(0.85, 1.3, 3))
    count = max(round(scene.rng.uniform(0.6, 0.95) * len(scene.honest)), 1)
    false = bench(machine, scene.rng, count, NOISE)
    kept = scene.rng.permutation(len(scene.honest))[: len(scene.honest) - count]
    return _mixed(scene, scene.honest.select(np.sort(kept)), false)


def _all_biased(scene: Scene) -> hmcvt.BenchSamples:
    by = scene.rng.choice([-1.0, 1.0]) * scene.rng.uniform(0.01, 0.12)
    return shifted(scene.honest, np.full(len(scene.honest), by))


def _all_of_wrong_gain(scene: Scene) -> hmcvt.BenchSamples:
    by = scene.rng.choice([-1.0, 1.0]) * scene.rng.uniform(0.01, 0.12)
    return shifted(scene.honest, by * scene.honest.efficiency)


def _drifting(scene: Scene) -> hmcvt.BenchSamples:
    """Readings that begin right and end 2 to 12 points off."""
    end = scene.rng.choice([-1.0, 1.0]) * scene.rng.uniform(0.02, 0.12)
    return shifted(scene.honest, np.linspace(0.0, end, len(scene.honest)))


def _one_many_times(scene: Scene) -> hmcvt.BenchSamples:
    """One false sample ten times, its operating point and reading jittered."""
    i = int(scene.rng.integers(len(scene.honest)))
    by = scene.rng.choice([-1.0, 1.0]) * scene.rng.uniform(0.03, 0.30)
    centre = np.array(scene.honest.points[:3])[:, i]
    jitter = scene.rng.choice([0.005, 0.01, 0.03])
    return _mixed(
        scene, scene.honest, _cluster(scene, centre, jitter, 10, by), shuffle=False
    )


def _cluster_apart(scene: Scene) -> hmcvt.BenchSamples:
    """Honest samples on one side, and false ones where no honest sample is."""
    side = scene.honest.displacement_ratio > -0.2
    by = scene.rng.choice([-1.0, 1.0]) * scene.rng.uniform(0.03, 0.20)
    while True:
        speed = scene.rng.uniform(80.0, 230.0)
        torque = np.clip(scene.rng.uniform(18e3, 60e3) / speed, 40.0, 400.0)
        centre = np.array([scene.rng.uniform(-0.95, -0.5), speed, torque])
        if np.isfinite(scene.unit.efficiency(*centre)):
            break
    jitter = scene.rng.choice([0.01, 0.03, 0.1])
    false = _cluster(scene, centre, jitter, int(scene.rng.integers(3, 13)), by)
    return _mixed(scene, scene.honest.select(side), false, shuffle=False)


def _old_rows_again(scene: Scene) -> hmcvt.BenchSamples:
    """Samples from before the wear, appended again."""
    count = max(round(scene.rng.uniform(0.4, 1.5) * len(scene.honest)), 1)
    return _mixed(scene, scene.honest, bench(scene.served, scene.rng, count, NOISE))


def _single_outliers(scene: Scene) -> hmcvt.BenchSamples:
    count = int(scene.rng.integers(1, 6))
    rows = scene.rng.choice(len(scene.honest), count, replace=False)
    by = np.zeros(len(scene.honest))
    signs = scene.rng.choice([-1.0, 1.0], count)
    by[rows] = signs * scene.rng.uniform(0.03, 0.30, count)
    return shifted(scene.honest, by)


ATTACKS = (
    Attack("a false machine for 50 to 95 % of the samples", _false_majority),
    Attack("a false machine within wear, 60 to 95 %", _false_majority_like_wear),
    Attack("all readings biased by 1 to 12 points", _all_biased, all_wrong=True),
    Attack("a wrong gain of all readings", _all_of_wrong_gain, all_wrong=True),
    Attack("readings that drift by 2 to 12 points", _drifting),
    Attack("one false sample ten times, jittered", _one_many_times),
    Attack("a false cluster where no honest sample is", _cluster_apart),
    Attack("samples from before the wear, again", _old_rows_again),
    Attack("1 to 5 single outliers", _single_outliers),
)


def _cluster(
    scene: Scene, centre: np.ndarray, jitter: float, count: int, by: float
) -> hmcvt.BenchSamples:
    """Return false samples about a point; those that the unit cannot carry read as the centre."""
    spread = jitter * _SIZE * scene.rng.uniform(-1.0, 1.0, (count, 3))
    points = centre + spread
    points[:, 0] = np.clip(points[:, 0], -1.0, 1.0)
    ratio, speed, torque = points.T
    truth = np.asarray(scene.unit.efficiency(ratio, speed, torque))
    truth = np.where(np.isfinite(truth), truth, scene.unit.efficiency(*centre))
    readings = truth + by + NOISE * scene.rng.standard_normal(count)
    return hmcvt.BenchSamples(ratio, speed, torque, np.clip(readings, 0.01, 0.99))


def _mixed(
    scene: Scene,
    honest: hmcvt.BenchSamples,
    false: hmcvt.BenchSamples,
    shuffle: bool = True,
) -> hmcvt.BenchSamples:
    """Return both kinds, in random order or the false ones last."""
    if not len(honest):
        return false
    both = joined([honest, false])
    if not shuffle:
        return both
    return both.select(scene.rng.permutation(len(both)))


# --- campaigns ------------------------------------------------------------------------------------


def scene(seed: int) -> Scene:
    """Return a scene with a unit worn within `MAX_CHANGE` of the model in service."""
    rng = np.random.default_rng(seed)
    example = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    known = bench(example, rng, KNOWN, NOISE)
    served = hmcvt.identify(known, schedule=QUICK, stage=example.stage).model
    # Without much wear a false machine does most harm.
    factors = 1.0 + rng.uniform() * (rng.uniform(1.0, [2.0, 1.5, 1.5]) - 1.0)
    grid = _grid(served)
    while np.nanmax(np.abs(_at(worn(served, factors), grid) - _at(served, grid))) > (
        0.9 * MAX_CHANGE
    ):
        factors = 1.0 + 0.8 * (factors - 1.0)
    unit = worn(served, factors)
    honest = bench(unit, rng, int(rng.integers(20, 61)), NOISE)
    return Scene(rng, served, unit, honest)


@dataclass(frozen=True)
class Outcome:
    """Largest errors over the domain [-] of what serves, and what became of the refit.

    Attributes:
        in_service: error of the model in service.
        clean: error of what serves after a refit to the honest samples.
        attacked: error of what serves after a refit to the logged samples.
        clean_adopted: whether the node adopts the refit to the honest samples.
        adopted: whether the node adopts the other.
    """

    in_service: float
    clean: float
    attacked: float
    clean_adopted: bool
    adopted: bool

    @property
    def excess(self) -> float:
        """Error in excess of the larger of the clean refit and the model in service [-]."""
        return self.attacked - max(self.clean, self.in_service)


def attacked(task: tuple[int, int]) -> Outcome:
    """Return the outcome of attack `task[0]` with seed `task[1]`."""
    attack = ATTACKS[task[0]]
    start = scene(task[1])
    clean = refit(start.honest, start.served, start.served)
    spoiled = refit(attack.samples(start), start.served, start.served)
    grid = _grid(spoiled.model)
    truth = _at(start.unit, grid)

    def error(model: hmcvt.EfficiencyModel) -> float:
        return float(np.nanmax(np.abs(_at(model, grid) - truth)))

    return Outcome(
        in_service=error(start.served),
        clean=error(_serving(clean, start)),
        attacked=error(_serving(spoiled, start)),
        clean_adopted=_adopted(clean),
        adopted=_adopted(spoiled),
    )


def diagnosed(task: tuple[int, int]) -> str:
    """Return the verdict of the node's diagnosis of the attacked samples; empty without one.

    Args:
        task: number of the attack, and seed.
    """
    start = scene(task[1])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model = folder / "model.yaml"
        bench_file = folder / "bench.csv"
        hmcvt.save_model(start.served, model)
        hmcvt.write_bench(bench_file, ATTACKS[task[0]].samples(start))
        try:
            answer = jobs.diagnose(bench_file, model, 0, folder / "reports")
        except hmcvt.HmcvtError:
            return ""
    return str(answer["verdict"]) if answer["report"] else ""


def harmful(attack: Attack, outcome: Outcome) -> bool:
    """Whether an attack did more than is allowed for its kind."""
    allowed = MAX_CHANGE if attack.all_wrong else _POINT
    return outcome.excess > allowed


def _adopted(result: Refit) -> bool:
    return not result.refused and not result.doubt


def _serving(result: Refit, start: Scene) -> hmcvt.EfficiencyModel:
    return result.model if _adopted(result) else start.served


def _grid(model: hmcvt.EfficiencyModel) -> list[np.ndarray]:
    assert model.domain is not None
    axes = [
        np.linspace(low, high, 9) for low, high in model.domain.to_mapping().values()
    ]
    return list(np.meshgrid(*axes))


def _at(model: hmcvt.EfficiencyModel, grid: list[np.ndarray]) -> np.ndarray:
    return np.nan_to_num(model.efficiency(*grid))
