# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which campaigns a blind trial makes, and how each is drawn from its seed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hmcvt_core.errors import InputError
from studies.blind.campaign import Campaign, make_campaign
from studies.blind.catalogue import KNOWN_EFFECTS, TURNED_EFFECTS, UNKNOWN_EFFECTS
from studies.blind.visible import visible

DETECTABLE, IMAGE = 18.0, 0.9
"""Squared deviations that a detectable effect leaves; squared cosine of two that are images."""

NOISES = {"0.4 %": 0.004, "0.1 %": 0.001}
LOOP = "test by test"
STRESS: dict[str, dict[str, Any]] = {
    "noise stated at half": {"stated_noise_factor": 0.5},
    "noise stated at 1.5": {"stated_noise_factor": 1.5},
    "noise not stated": {"stated_noise_factor": None},
    "48 samples": {"samples": 48},
    "1.1 % noise": {"efficiency_noise": 0.011},
}
PARTS = (*NOISES, "stress", LOOP)

_SETS = {"pair": 2, "triple": 3}
_KINDS = (
    *KNOWN_EFFECTS,
    *UNKNOWN_EFFECTS,
    *TURNED_EFFECTS,
    *_SETS,
    "none",
    "base off",
    "faint",
)
_COUNTS = {
    "pair": 5,
    "triple": 3,
    "none": 8,
    "base off": 8,
    "faint": 2,
}  # to each single effect

_LEFT_OUT = {
    LOOP: ("base off", "faint"),
    **dict.fromkeys(STRESS, (*TURNED_EFFECTS, "triple", "base off", "faint")),
}
_GROUPS = {
    **dict.fromkeys(KNOWN_EFFECTS, "single"),
    **dict.fromkeys(UNKNOWN_EFFECTS, "unlisted"),
    **dict.fromkeys(TURNED_EFFECTS, "wrong sign"),
}
LISTED = ("single", *_SETS)  # listed effects, and nothing else, are to be found
STRANGE = ("unlisted", "wrong sign")

SHIFTS = (0.007, 0.03)  # of the efficiency, drawn evenly in its logarithm
_FAINT = 0.3  # times that
MISFITS = (0.001, 0.002)
_MISFIT_SHARE, _TEMPERATURE_SHARE, _SPEED_SHARE, _PRESSURE_SHARE = 1 / 3, 0.5, 0.9, 0.5
_SWINGS, _SWEPT = (
    (3.0, 25.0),
    10.0,
)  # deg C; at least so much where viscosity is the effect
_GAUGE = (0.005, 5e4)  # standard deviations of gain and zero of a gauge of pressure
_ATTEMPTS, _GROWTH = 100, 1.03


@dataclass(frozen=True)
class Case:
    """One campaign to diagnose.

    Attributes:
        condition: name of the conditions it is measured under.
        kind: name of its effect (a minus before it: of the wrong sign), or one of `_COUNTS`.
        seed: of plant, effects, columns, plan and noise.
    """

    condition: str
    kind: str
    seed: int

    @property
    def key(self) -> str:
        """A name that no other case has."""
        return f"{self.condition}/{self.kind}/{self.seed}"

    @property
    def group(self) -> str:
        """What it is scored among: `single`, `unlisted`, `wrong sign`, or its kind."""
        return _GROUPS.get(self.kind, self.kind)


def cases(first: int, seeds: int, parts: Sequence[str] = PARTS) -> list[Case]:
    """Return the cases of a trial.

    Args:
        first: seed from which all others are counted.
        seeds: campaigns per single effect at either noise; a sixth of it test by test and a twelfth
            in each stress, at least one.
        parts: which of `PARTS` to make.
    """
    sizes = {
        **dict.fromkeys(NOISES, seeds),
        LOOP: max(1, seeds // 6),
        **dict.fromkeys(STRESS, max(1, seeds // 12)),
    }
    chosen = [
        name
        for name in sizes
        if name in parts or (name in STRESS and "stress" in parts)
    ]
    return [
        Case(condition, kind, first + 1000 * (len(_KINDS) * place + number) + i)
        for place, condition in enumerate(sizes)
        if condition in chosen
        for number, kind in enumerate(_KINDS)
        if kind not in _LEFT_OUT.get(condition, ())
        for i in range(sizes[condition] * _COUNTS.get(kind, 1))
    ]


def draw(case: Case) -> Campaign:
    """Draw campaigns of a kind from its seed on; return the first that is as it has to be.

    Every effect is detectable beside the others, and no two are each other's image; a faint one is
    not detectable. Effects grow, and faint ones shrink, until that is so.
    """
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([case.seed, attempt, 17])
        effects, options = _effects(case, attempt, rng), _options(case, rng)
        if any(name == "oil_temperature" for name, _ in effects):
            options["temperature_swing"] = max(
                options["temperature_swing"] or 0.0, _SWEPT
            )
        try:
            campaign = make_campaign(
                _ATTEMPTS * case.seed + attempt, effects, **options
            )
        except InputError:  # it stalls
            continue
        seen = visible(campaign)
        faint = any(left < DETECTABLE for left in seen.left)
        if faint == (case.kind == "faint") and seen.alike < IMAGE:
            return campaign
    raise InputError(f"{case.key}: no campaign of {_ATTEMPTS} is as it has to be")


def _effects(
    case: Case, attempt: int, rng: np.random.Generator
) -> list[tuple[str, float]]:
    names = [case.kind]
    if case.kind in _COUNTS:
        count = {"none": 0, "base off": 0, "faint": 1, **_SETS}[case.kind]
        names = [str(name) for name in rng.choice(KNOWN_EFFECTS, count, replace=False)]
    factor: float = _GROWTH**attempt
    if case.kind == "faint":
        factor = _FAINT * NOISES.get(case.condition, 0.004) / 0.004 / factor
    return [(name, factor * log_uniform(SHIFTS, rng)) for name in names]


def _options(case: Case, rng: np.random.Generator) -> dict[str, Any]:
    """Columns and misfit are drawn whatever the effect: they must not give it away."""
    temperature, speed, pressure, off = rng.random(4)
    misfit, swing = log_uniform(MISFITS, rng), log_uniform(_SWINGS, rng)
    gauge = tuple(rng.normal(0.0, _GAUGE).tolist())
    exact = case.kind == "none" or (case.kind != "base off" and off > _MISFIT_SHARE)
    return {
        "efficiency_noise": NOISES.get(case.condition, 0.004),
        "output_speed_noise": 0.001 if speed < _SPEED_SHARE else None,
        "pressure_gauge": gauge if pressure < _PRESSURE_SHARE else None,
        "temperature_swing": swing if temperature < _TEMPERATURE_SHARE else None,
        "misfit": 0.0 if exact else misfit,
        **STRESS.get(case.condition, {}),
    }


def log_uniform(limits: tuple[float, float], rng: np.random.Generator) -> float:
    """Draw a number whose logarithm is uniform between limits."""
    return float(np.exp(rng.uniform(*np.log(limits))))
