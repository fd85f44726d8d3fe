# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Simulation-based calibration: are the probabilities right where the model is true?

    python -m studies.sbc [DRAWS] [RESULTS.jsonl] [JOBS]

Every truth is drawn from the prior of the diagnosis itself: one to three listed effects, a form
with shapes that are tried, sizes by the moment prior, base parameters, the errors that readings
share, and the noise with its inverse-gamma statement (Talts et al. 2018, arXiv 1804.06788; Cook,
Gelman & Rubin 2006). The readings come from the library's own system, so any lack of calibration is
one of the computation, not of forms. Unlisted causes, an inexact base and sound machines are not
drawn; every probability is therefore also given among the listed sets.

Prints ranks of the sizes and the probabilities by band. With RESULTS an interrupted run goes on
where it stopped.
"""

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import kstest, norm

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission.meters import with_meter_errors
from hmcvt_core.benches.transmission.readings import distinct_observations
from hmcvt_core.benches.transmission.system import Transmission
from hmcvt_core.diagnosis.settings import PRIOR_OF_SET_SIZE, SIZE_SPREADS
from hmcvt_core.diagnosis.system import Points
from hmcvt_tools.fleet.executors import Processes
from studies.blind.bench.scores import share
from studies.page import table
from studies.workers import recorded

DRAWS = 400
#: First seed of the draws.
FIRST_SEED = 97_200_000
MODEL_FILE = "params/hm4.yaml"
_TESTS = (16, 24, 48)
_SESSIONS = 2
#: Ranges of the tests: stroke, engine speed [rad/s], load torque [N m], oil [deg C].
_STROKE = (-0.95, 0.95)
_SPEED = (80.0, 230.0)
_LOAD = (60.0, 420.0)
_OIL = (40.0, 80.0)
_NOISE = 0.002
_ATTEMPTS = 200
#: Smallest efficiency of a test, and smallest change by an effect that acts at all, in deviations.
_MIN_EFFICIENCY = 0.2
_MIN_CHANGE = 1e-6
_BANDS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
_BINS = 5


@dataclass(frozen=True)
class Draw:
    """A truth of the prior, and its readings.

    Attributes:
        system: of the library.
        observed: readings with noise and shared errors.
        base: parameters of the base model.
        effects: that are present, at their sizes.
    """

    system: Transmission
    observed: hmcvt.Observations
    base: np.ndarray
    effects: tuple[Any, ...]

    def lost_power(self, name: str, points: Points) -> float:
        """Return the mean power that an effect takes over some tests [W]."""
        others = [effect for effect in self.effects if effect.name != name]
        without = self.system.predict(self.base, others, points)[0]
        whole = self.system.predict(self.base, self.effects, points)[0]
        return float(np.nanmean(self.system.lost_power(points, without, whole)))


def draw(seed: int) -> Draw:
    """Draw a truth and its readings.

    Raises:
        InputError: no draw of the seed can be run.
    """
    rng = np.random.default_rng([seed, 56])
    model = hmcvt.load_model(hmcvt.data_path(MODEL_FILE))
    for _ in range(_ATTEMPTS):
        samples = _plan(rng)
        system = Transmission(model, samples.columns)
        base = rng.normal(system.base.mean, system.base.spread)
        base = np.clip(base, system.base.low, system.base.high)
        effects = _effects(system, rng)
        observed, _ = distinct_observations(samples, None, list(model.stages))
        alone = system.predict(base, (), observed.points)
        whole = system.predict(base, effects, observed.points)
        if not _usable(alone, whole):
            continue
        parts = [system.predict(base, (effect,), observed.points) for effect in effects]
        deviation = observed.deviation
        changes = [np.nanmax(np.abs(part - alone) / deviation) for part in parts]
        if min(changes) < _MIN_CHANGE:
            continue  # an effect that no test reaches is no candidate
        return Draw(system, _read(samples, whole, system, model, rng), base, effects)
    raise hmcvt.errors.InputError(f"seed {seed}: no draw of {_ATTEMPTS} can be run")


def _usable(alone: np.ndarray, whole: np.ndarray) -> bool:
    """Whether a machine runs at every test with and without its effects."""
    finite = np.isfinite(alone).all() and np.isfinite(whole).all()
    return bool(finite and min(alone[0].min(), whole[0].min()) > _MIN_EFFICIENCY)


def _plan(rng: np.random.Generator) -> hmcvt.BenchSamples:
    """Return tests with every column; their readings are yet to come."""
    tests = int(rng.choice(_TESTS))
    within = rng.random((4, tests))
    ranges = np.array([_STROKE, _SPEED, _LOAD, _OIL])
    stroke, speed, load, oil = ranges[:, :1] + np.diff(ranges) * within
    session = (np.arange(tests) * _SESSIONS) // tests
    stamp = 300.0 * np.arange(tests) + 1e5 * session
    return hmcvt.BenchSamples(
        stroke,
        speed,
        load,
        np.full(tests, 0.8),
        output_speed=speed,
        pressure=np.full(tests, 1e7),
        oil_temperature=oil,
        efficiency_std=np.full(tests, _NOISE),
        stamp=stamp,
        extra={"session": tuple(f"S{number + 1}" for number in session)},
    )


def _effects(system: Transmission, rng: np.random.Generator) -> tuple[Any, ...]:
    """Draw a set of effects by the prior."""
    names = sorted({effect.name for effect in system.library})
    weights = np.array(list(PRIOR_OF_SET_SIZE.values()))
    count = int(rng.choice(list(PRIOR_OF_SET_SIZE), p=weights / weights.sum()))
    effects = []
    for name in rng.choice(names, count, replace=False):
        forms = [effect for effect in system.library if effect.name == name]
        effects.append(_sized(forms[rng.integers(len(forms))], rng))
    return tuple(effects)


def _sized(effect: Any, rng: np.random.Generator) -> Any:
    """Draw shapes among those tried, and the size by the moment prior within its bounds."""
    values = {}
    for item in effect.parameters():
        if not item.is_size:
            values[item.name] = float(rng.choice(item.grid))
    size = effect.sizes()[0]
    while True:
        spread = size.typical * rng.choice(SIZE_SPREADS)
        # The density a^2 exp(-a^2 / 2) is that of the length of a normal vector of three.
        drawn = spread * float(np.linalg.norm(rng.standard_normal(3)))
        if size.low < 0.0:
            drawn *= rng.choice([-1.0, 1.0])
        if size.low <= drawn <= size.high:
            return effect.with_values({**values, size.name: float(drawn)})


def _read(
    samples: hmcvt.BenchSamples,
    predicted: np.ndarray,
    system: Transmission,
    model: hmcvt.EfficiencyModel,
    rng: np.random.Generator,
) -> hmcvt.Observations:
    """Return readings with noise and shared errors, as the diagnosis assumes them."""
    stages = list(model.stages)
    exact = replace(
        samples,
        **{
            channel.name: values
            for channel, values in zip(system.channels, predicted, strict=True)
        },
    )
    observed, _ = distinct_observations(exact, None, stages)
    with_errors = with_meter_errors(observed, system)
    measured = with_errors.measured.copy()
    if with_errors.shared_errors is not None:
        errors = rng.standard_normal(with_errors.shared_errors.shape[-1])
        measured += with_errors.shared_errors @ errors
    # Variances are inverse gamma about those stated.
    dof = with_errors.prior_dof[:, None]
    scale = np.sqrt(dof / rng.chisquare(dof))
    noise = with_errors.deviation * scale * rng.standard_normal(measured.shape)
    return replace(with_errors, measured=measured + noise)


# --- one draw, diagnosed ----------------------------------------------------------------------


def calibrated(seed: int) -> dict[str, Any]:
    """Return a draw and its diagnosis as a record."""
    try:
        truth = draw(seed)
        found = hmcvt.diagnose_system(truth.system, truth.observed)
    except hmcvt.errors.InputError as error:
        return {"seed": seed, "error": str(error)}
    answer = found.to_dict()
    names = sorted(effect.name for effect in truth.effects)
    nothing: dict[str, Any] = {"effects": [], "probability": 0.0}
    first = answer["sets"][0] if answer["sets"] else nothing
    is_right = sorted(first["effects"]) == names
    return {
        "seed": seed,
        "tests": len(truth.observed),
        "truth": names,
        "forms": {effect.name: effect.form for effect in truth.effects},
        "verdict": answer["verdict"],
        "unlisted": answer["unlisted_probability"],
        "first": [sorted(first["effects"]), first["probability"]],
        "listed": sum(item["probability"] for item in answer["sets"]),
        "inclusion": {
            cause["effect"]: cause["probability"] for cause in answer["causes"]
        },
        "ranks": _ranks(truth, answer) if is_right else {},
        "power_ranks": _power_ranks(truth, found) if is_right else {},
    }


def _ranks(truth: Draw, answer: dict[str, Any]) -> dict[str, float]:
    """Return the place of each true size in its posterior, 0 to 1, where the form is right."""
    ranks = {}
    for effect in truth.effects:
        for cause in answer["causes"]:
            if cause["effect"] != effect.name or (cause["form"] or "") != effect.form:
                continue
            name = effect.sizes()[0].name
            fitted = cause["parameters"][name]
            if not fitted.get("standard_error"):
                continue
            pull = (effect.values()[name] - fitted["value"]) / fitted["standard_error"]
            ranks[effect.name] = float(norm.cdf(pull))
    return ranks


def _power_ranks(truth: Draw, found: hmcvt.Diagnosis) -> dict[str, float]:
    """Return the place of each true mean power in its posterior, 0 to 1."""
    hidden = [(effect.name,) for effect in truth.effects]
    points = found.posterior.base_only.fit.observed.points  # of the tests that count
    ranks = {}
    for member in found.members:
        error = member.lost_power_error
        if member.effects not in hidden or member.lost_power is None or not error:
            continue
        (name,) = member.effects
        pull = (truth.lost_power(name, points) - member.lost_power) / error
        ranks[name] = float(norm.cdf(pull))
    return ranks


# --- tables -----------------------------------------------------------------------------------


def report(records: Sequence[dict[str, Any]]) -> str:
    """Return ranks and bands of the records of a run."""
    usable = [record for record in records if "error" not in record]
    with_gap = [record for record in usable if record["verdict"] != "no_gap"]
    parts = [
        f"{len(usable)} draws, {len(with_gap)} with a gap, {len(records) - len(usable)} not run",
        _rank_lines("sizes where the set and the form are right", usable, "ranks"),
        _rank_lines("mean powers where the set is right", usable, "power_ranks"),
        _band_table("first set", [_of_first(record) for record in with_gap]),
        _band_table("inclusion", [pair for r in with_gap for pair in _of_members(r)]),
    ]
    return "\n\n".join(parts)


def _rank_lines(what: str, records: Sequence[dict[str, Any]], key: str) -> str:
    """Return the counts of ranks in even bins, and the test of uniformity.

    Args:
        what: has the ranks, in words.
        records: of draws.
        key: of the ranks in a record.
    """
    ranks = [rank for record in records for rank in record[key].values()]
    if not ranks:
        return f"no ranks of {what}: no leading set is the one drawn"
    counts, _ = np.histogram(ranks, _BINS, (0.0, 1.0))
    p_value = kstest(ranks, "uniform").pvalue
    head = [f"{k / _BINS:.1f} to {(k + 1) / _BINS:.1f}" for k in range(_BINS)]
    title = f"Ranks of {len(ranks)} {what}; ranks uniform: p = {p_value:.3f}"
    return f"{title}\n\n{table(head, [counts.tolist()])}"


def _of_first(record: dict[str, Any]) -> tuple[float, float, bool]:
    """Probability of the first set, the same among the listed sets, and whether it is right."""
    names, probability = record["first"]
    return probability, _among_listed(probability, record), names == record["truth"]


def _of_members(record: dict[str, Any]) -> list[tuple[float, float, bool]]:
    """The same of every effect that is reported."""
    return [
        (probability, _among_listed(probability, record), name in record["truth"])
        for name, probability in record["inclusion"].items()
    ]


def _among_listed(probability: float, record: dict[str, Any]) -> float:
    return min(1.0, probability / max(record["listed"], 1e-9))


def _band_table(what: str, answers: Sequence[tuple[float, float, bool]]) -> str:
    """Return how often answers are right by their probability, as said and among listed sets."""
    rows = []
    for low, high in pairwise(_BANDS):
        cells = []
        for number in (0, 1):
            inside = [item for item in answers if low < item[number] <= high]
            if not inside:
                cells += ["", ""]
                continue
            mean = np.mean([item[number] for item in inside])
            cells += [f"{mean:.2f}", share([item[2] for item in inside])]
        rows.append((f"{low:.1f} to {high:.1f}", *cells))
    head = (
        f"probability of the {what}",
        "mean",
        "right",
        "among listed: mean",
        "right",
    )
    return table(head, rows)


def main() -> None:
    """Run the study."""
    arguments = sys.argv[1:]
    draws = int(arguments[0]) if arguments else DRAWS
    path = Path(arguments[1]) if len(arguments) > 1 else Path(os.devnull)
    jobs = int(arguments[2]) if len(arguments) > 2 else os.cpu_count() or 1
    seeds = {str(FIRST_SEED + k): FIRST_SEED + k for k in range(draws)}
    records = []
    with Processes(jobs) as pool:
        for record in recorded(pool, calibrated, seeds, path):
            records.append(record)
            print(f"{len(records)} of {draws} draws", file=sys.stderr)
    print(report(records))


if __name__ == "__main__":
    main()
