# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A measuring campaign on the twin: noisy bench samples, the truth behind them and their label."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hmcvt_core.errors import InputError
from studies.blind.catalogue import draw_effect, size_effect
from studies.blind.effect import Effect, FloatArray
from studies.blind.plans import LOAD_TORQUE, random_points
from studies.blind.twin import BaseTruth, OperatingPoints, Plant, Readings

#: Ranges from which base parameters are drawn, log-uniformly: m3/(s Pa), N m s/rad twice. A fit
#: of the base plant to Table 2 lies inside (1.8e-11, 0.185, 0.101).
BASE_RANGES = {
    "leakage": (1e-11, 4e-11),
    "motor_damping": (0.06, 0.25),
    "pump_damping": (0.05, 0.25),
}
#: Independent random streams of one seed.
_BASE, _EFFECTS, _PLAN, _NOISE = 1, 2, 3, 4
_MISFIT = 9  # place of the misfit behind the effects
_MEAN_OF_NORMAL = (
    1.25  # of a normal variable: its mean square over its mean absolute value and rms
)
#: A stalled point is measured again at this share of its load, as an operator would.
_LOAD_RELIEF = 0.85


@dataclass(frozen=True)
class CampaignOptions:
    """How a campaign is measured.

    `efficiency_noise` is a standard deviation in units of efficiency; `output_speed_noise` one
    relative to the speed, None leaves the column out. `pressure_gauge` is gain - 1 and zero (Pa) of
    the gauge of the loop pressure, None leaves the column out.
    `temperature_swing` adds the column oil_temperature, uniform in 60 deg C +- swing.
    `misfit` is the root mean square of the smooth field by which the efficiency of the base differs
    from its form (misfit.BaseMisfit). `stated_noise_factor` x noise stands in the column
    efficiency_std, None leaves it out.
    """

    samples: int = 96
    efficiency_noise: float = 0.004
    output_speed_noise: float | None = 0.001
    pressure_gauge: tuple[float, float] | None = None
    misfit: float = 0.0
    temperature_swing: float | None = None
    stated_noise_factor: float | None = 1.0

    def __post_init__(self) -> None:
        if min(self.efficiency_noise, self.misfit) < 0.0:
            raise InputError("noise and misfit must not be below 0")


@dataclass(frozen=True)
class Bench:
    """A plant on a bench: the base, what is hidden in it, what its base form misses, its meters."""

    base: BaseTruth
    effects: tuple[Effect, ...]
    options: CampaignOptions
    misfit: tuple[Effect, ...] = ()

    def plant(self, *effects: Effect) -> Plant:
        """Return the plant with some of the effects."""
        return Plant(self.base, (*effects, *self.misfit))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects, without variants."""
        return tuple(effect.name for effect in self.effects)

    def measure(self, seed: int, wanted: OperatingPoints | None = None) -> Campaign:
        """Measure at operating points, of the plan unless some are wanted, with noise of a seed."""
        options = self.options
        if wanted is None:
            rng = np.random.default_rng([seed, _PLAN])
            swing = options.temperature_swing or 0.0
            wanted = random_points(options.samples, rng, swing)
        points, read, plain = _carry(self.plant(*self.effects), self.plant(), wanted)
        truth = {
            "efficiency": read.efficiency,
            "efficiency_plain": plain.efficiency,
            "output_speed": read.output_speed,
            "load_torque": points.load_torque,
            "oil_temperature": points.oil_temperature,
        }
        noise = np.random.default_rng([seed, _NOISE])
        return Campaign(_samples(points, read, options, noise), truth, self)


@dataclass(frozen=True)
class Campaign:
    """Samples by contract column, arrays of truth without noise, and their bench; shape (n,) each.

    `truth` holds efficiency (with meter error, without noise), efficiency_plain (same points, no
    effect), output_speed, load_torque, oil_temperature.
    """

    samples: dict[str, FloatArray]
    truth: dict[str, FloatArray]
    bench: Bench


def make_campaign(
    seed: int, effects: Sequence[tuple[str, float]] = (), **options: Any
) -> Campaign:
    """Measure a campaign on a plant drawn from `seed`.

    `effects` are (name, target shift) pairs for `draw_effect` and `size_effect` of the catalogue;
    `options` are fields of CampaignOptions. Equal arguments give equal campaigns. Raises InputError
    for unknown names, bad numbers, or oil_temperature without temperature_swing.
    """
    chosen = CampaignOptions(**options)
    base = draw_base(np.random.default_rng([seed, _BASE]))

    def hidden(name: str, target: float, place: int) -> Effect:
        effect = draw_effect(name, np.random.default_rng([seed, _EFFECTS, place]))
        if effect.name == "oil_temperature" and not chosen.temperature_swing:
            raise InputError("effect 'oil_temperature' needs temperature_swing")
        return size_effect(base, effect, target, chosen.temperature_swing or 0.0)

    sized = tuple(hidden(*each, place) for place, each in enumerate(effects))
    off = (
        [("base_misfit", _MEAN_OF_NORMAL * chosen.misfit, _MISFIT)]
        if chosen.misfit
        else []
    )
    return Bench(base, sized, chosen, tuple(hidden(*each) for each in off)).measure(
        seed
    )


def fresh(campaign: Campaign, seed: int, **options: Any) -> Campaign:
    """Measure the same plant anew: other operating points, other noise; options may be others."""
    bench = replace(campaign.bench, options=replace(campaign.bench.options, **options))
    try:
        return bench.measure(seed)
    except InputError:  # a point stalls at any load
        return fresh(campaign, seed + 1, **options)


def pressure_noise(pressure: FloatArray) -> FloatArray:
    """Standard deviation of a gauge of class A (ISO 4409), Pa: 0.5 %, and what it resolves."""
    return np.asarray(np.hypot(0.005 * pressure, 4e4))


def draw_base(rng: np.random.Generator) -> BaseTruth:
    """Draw base parameters within BASE_RANGES."""
    # One draw of three, lest old seeds give other plants.
    return BaseTruth(
        **{
            name: float(low * (high / low) ** rng.uniform(size=3)[0])
            for name, (low, high) in BASE_RANGES.items()
        }
    )


def _carry(
    plant: Plant, plain_plant: Plant, points: OperatingPoints
) -> tuple[OperatingPoints, Readings, Readings]:
    """Lower the load where the plant stalls, with or without effects, until it runs everywhere."""
    for _ in range(20):
        plain = plain_plant.read(points)
        read = plant.read(points)
        stalled = ~(read.settled & plain.settled)
        if not np.any(stalled):
            return points, read, plain
        eased = np.maximum(points.load_torque * _LOAD_RELIEF, LOAD_TORQUE[0])
        points = replace(
            points, load_torque=np.where(stalled, eased, points.load_torque)
        )
    raise InputError(
        f"the plant stalls at {int(np.sum(stalled))} operating point(s) at any load"
    )


def _samples(
    points: OperatingPoints,
    read: Readings,
    options: CampaignOptions,
    rng: np.random.Generator,
) -> dict[str, FloatArray]:
    """Contract columns with noise."""
    count, sigma = len(points), options.efficiency_noise
    efficiency = read.efficiency + sigma * rng.standard_normal(count)
    speed_scatter = rng.standard_normal(count)
    samples = {
        "displacement_ratio": points.displacement_ratio,
        "engine_speed": points.engine_speed,
        "load_torque": read.load_torque,
        "efficiency": np.clip(efficiency, 0.011, 0.999),
    }
    if options.output_speed_noise is not None:
        factor = 1.0 + options.output_speed_noise * speed_scatter
        samples["output_speed"] = read.output_speed * factor
    if options.pressure_gauge is not None:
        gain, zero = options.pressure_gauge
        scatter = pressure_noise(read.state[0]) * rng.standard_normal(count)
        samples["pressure"] = read.state[0] * (1.0 + gain) + zero + scatter
    if options.temperature_swing is not None:
        samples["oil_temperature"] = points.oil_temperature
    if options.stated_noise_factor is not None:
        samples["efficiency_std"] = np.full(
            count, max(sigma * options.stated_noise_factor, 1e-6)
        )
    return samples
