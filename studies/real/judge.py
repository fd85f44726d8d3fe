# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""One comparison of a rig with its sound state, or one band of a unit, and whether it is right."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from hmcvt_core.benches.unit import UnitChange, UnitDiagnosis, diagnose_unit
from hmcvt_core.benches.unit.samples import UnitSamples
from hmcvt_core.diagnosis.results.outcome import NAMING
from hmcvt_core.errors import InputError
from hmcvt_core.model.intervals import half_width

from .rig import SOUND_COOLER, Mask, Rig

HALVES = 20
"""Random divisions of the sound windows."""
HELD_OUT_FRACTION = 1.0 / 3.0
"""Fraction of the changed windows that is held out."""
MIN_REMOVED = 0.8
"""Fraction of the squared gap that a named change has to remove on held-out windows."""
MIN_BAND_REMOVED = 0.6
"""Fraction of the squared gap to be removed in a held-out band of a unit, on the median."""
TRUE_EFFECT = "orifice_leakage"
"""The leak of the rig is an orifice."""
WRONG_PROBABILITY = 0.8
"""Probability from which a wrong part counts as stated."""
BANDS = ((0.7, "high"), (0.3, "low"))
"""Fraction of the largest pressure or speed beyond which samples are held out, on that side."""


@dataclass(frozen=True)
class Run:
    """One comparison.

    Attributes:
        kind: what is compared, as a word of the page.
        what: the windows.
        verdict: of the diagnosis.
        part: component that the diagnosis names, or `-`.
        leading: leading set of effects with its probability, or `-`.
        removed: part of the squared gap removed on held-out windows, or NaN.
        right: whether the outcome is what the rig's record says.
    """

    kind: str
    what: str
    verdict: str
    part: str
    leading: str
    removed: float
    right: bool


@dataclass(frozen=True)
class BandRun:
    """One channel of a unit in a band that is held out.

    Attributes:
        unit: name.
        axis: along which the band lies.
        channel: `flow` or `torque`.
        base: error of the paper's terms in the band [L/min] or [N m].
        served: error of the saved model.
        leading: leading set of effects.
        side: end of the axis, `high` or `low`.
        points: samples of the band.
        inside: those inside the 95 % interval of the saved model.
    """

    unit: str
    axis: str
    channel: str
    base: float
    served: float
    leading: str
    side: str = "high"
    points: int = 0
    inside: int = 0

    @property
    def removed(self) -> float:
        """Fraction of the squared error of the paper's terms that is removed."""
        return 1.0 - (self.served / self.base) ** 2


def sound_halves(rig: Rig, with_temperature: bool) -> list[Run]:
    """Compare random halves of the sound windows with the other halves."""
    runs = []
    rows = np.flatnonzero(rig.sound)
    for seed in range(HALVES):
        order = np.random.default_rng(seed).permutation(rows)
        half = _mask(rig, order[: len(order) // 2])
        change = _change(rig, half, rig.sound & ~half, with_temperature, seed)
        right = change.diagnosis.verdict == "no_gap"
        kind = _kind("sound half", with_temperature)
        runs.append(_run(kind, f"division {seed}", change, right))
    return runs


def leak_by_settings(rig: Rig, fault: float) -> list[Run]:
    """Compare a leak with the sound pump, for every setting apart."""
    runs = []
    for setting in rig.settings():
        at = rig.at(setting)
        faulty = at & (rig.fault == fault)
        if not faulty.any():
            continue
        what = f"leak {fault:g}, {setting}"
        runs.append(_leak("leak by setting", what, rig, faulty, at & rig.sound))
    return runs


def leak_by_coolers(rig: Rig, fault: float) -> list[Run]:
    """Compare a leak with the sound pump, at every setting of the cooler and at all together."""
    runs = []
    faulty = rig.fault == fault
    for cooler in sorted(set(rig.cooler.tolist()), reverse=True):
        at = rig.cooler == cooler
        what = f"leak {fault:g}, cooler {cooler:g} %"
        runs.append(_leak("leak", what, rig, faulty & at, rig.sound & at))
    runs.append(_leak("leak", f"leak {fault:g}, all", rig, faulty, rig.sound))
    return runs


def poor_coolers(rig: Rig, with_temperature: bool) -> list[Run]:
    """Compare all sound windows of a poor cooler with those of the sound cooler."""
    runs = []
    baseline = rig.sound & (rig.cooler == SOUND_COOLER)
    for cooler in sorted(set(rig.cooler.tolist()) - {SOUND_COOLER}, reverse=True):
        warm = rig.sound & (rig.cooler == cooler)
        change = _change(rig, warm, baseline, with_temperature, 0, held_out_part=0.0)
        diagnosis = change.diagnosis
        leads = bool(diagnosis.sets) and "oil_temperature" in diagnosis.sets[0].effects
        right = leads and diagnosis.verdict in NAMING
        if not with_temperature:
            right = right or diagnosis.verdict == "unexplained"
        kind = _kind("poor cooler", with_temperature)
        runs.append(_run(kind, f"cooler {cooler:g} %", change, right))
    return runs


def bands(name: str, samples: UnitSamples) -> list[BandRun]:
    """Fit a unit without the highest or lowest part of an axis, and predict that part.

    Where there is no gap, the paper's terms are kept and have no interval.
    """
    runs = []
    for axis, (part, side) in itertools.product(("pressure", "speed"), BANDS):
        values = getattr(samples, axis)
        held_out = values > part * values.max()
        if side == "low":
            held_out = ~held_out
        if held_out.all() or not held_out.any():
            continue
        beyond = samples.select(held_out)
        try:
            answer = diagnose_unit(samples.select(~held_out), beyond)
        except InputError:
            continue  # too few samples, or too low a pressure, remain
        assert isinstance(answer, UnitDiagnosis)
        for channel, factor in (("flow", 6e4), ("torque", 1.0)):
            row = answer.rmse[channel]
            base = row["holdout_base"]
            served = row["holdout_with_effects"]
            if base is None or served is None:
                continue
            runs.append(
                BandRun(
                    name,
                    axis,
                    channel,
                    factor * base,
                    factor * served,
                    _leading(answer.diagnosis),
                    side,
                    *_inside(answer, beyond, f"{channel}_loss"),
                )
            )
    return runs


def _inside(
    answer: UnitDiagnosis, samples: UnitSamples, channel: str
) -> tuple[int, int]:
    """Return the samples, and those inside the 95 % interval of the saved model."""
    if answer.served is None:
        return 0, 0
    error = getattr(samples, channel) - answer.served.predict(samples)[channel]
    deviation = answer.served.deviation(samples)[channel]
    return len(error), int(np.sum(np.abs(error) <= half_width(None, 0.95) * deviation))


def _kind(word: str, with_temperature: bool) -> str:
    if with_temperature:
        return word
    return f"{word}, oil temperature not read"


def _mask(rig: Rig, rows: np.ndarray) -> Mask:
    mask = np.zeros(len(rig.flow), dtype=bool)
    mask[rows] = True
    return mask


def _change(
    rig: Rig,
    changed: Mask,
    baseline: Mask,
    with_temperature: bool,
    seed: int,
    held_out_part: float = HELD_OUT_FRACTION,
) -> UnitChange:
    rows = np.random.default_rng(seed).permutation(np.flatnonzero(changed))
    held_out = _mask(rig, rows[: round(held_out_part * len(rows))])
    holdout = None
    if held_out.any():
        holdout = rig.samples(held_out, with_temperature)
    change = diagnose_unit(
        rig.samples(changed & ~held_out, with_temperature),
        holdout,
        baseline=rig.samples(baseline, with_temperature),
        seed=seed,
    )
    assert isinstance(change, UnitChange)
    return change


def _leak(kind: str, what: str, rig: Rig, faulty: Mask, sound: Mask) -> Run:
    change = _change(rig, faulty, sound, True, 0)
    in_sets = any(TRUE_EFFECT in item.effects for item in change.diagnosis.sets)
    right = change.component == "pump" and in_sets
    run = _run(kind, what, change, right)
    enough = run.removed >= MIN_REMOVED
    return Run(**{**vars(run), "right": run.right and enough})


def _run(kind: str, what: str, change: UnitChange, right: bool) -> Run:
    row = change.rmse["flow"]
    removed = float("nan")
    if row["holdout_base"]:
        left = row["holdout_with_effects"] or 0.0
        removed = 1.0 - (left / row["holdout_base"]) ** 2
    diagnosis = change.diagnosis
    part = change.component or "-"
    return Run(kind, what, diagnosis.verdict, part, _leading(diagnosis), removed, right)


def _leading(diagnosis: object) -> str:
    sets = getattr(diagnosis, "sets", ())
    if not sets:
        return "-"
    names = " + ".join(name.replace("_", " ") for name in sets[0].effects)
    return f"{names or 'none'} ({100.0 * sets[0].probability:.0f} %)"
