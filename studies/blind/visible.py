# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What of the effects in a campaign can be seen, whatever is made of it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from studies.blind.campaign import Bench, Campaign, pressure_noise
from studies.blind.catalogue import KNOWN_EFFECTS, draw_effect
from studies.blind.effect import FloatArray
from studies.blind.meters import TorqueSensor
from studies.blind.twin import OperatingPoints, Plant

_STEP = 0.05  # relative, of each base parameter
# One deviation of the errors that no bench is free of; of the gauge: gain, and zero in Pa.
_METER_GAIN, _GEAR_LOSS, _GAUGE = 0.0015, 0.0005, (0.01, 1e5)
_SHAPES, _SMALL = 8, 0.1  # of each listed effect, and their size


class Visible(NamedTuple):
    """Of each effect the squared deviations that it leaves, and how alike two effects look.

    `left` is over all channels, once the base parameters, the shared errors of a bench and the
    sizes of the other effects are refitted; `alike` the largest squared cosine between what two of
    them leave after the base alone.
    """

    left: tuple[float, ...]
    alike: float


class _Look:
    """What the meters of a campaign show, and what a refit of the base leaves of a change of it.

    Linear in the base parameters, with the plant itself in place of any model; with the true noise.
    """

    def __init__(self, campaign: Campaign) -> None:
        self.options, self.samples = campaign.bench.options, campaign.samples
        samples, truth, plain = campaign.samples, campaign.truth, campaign.bench.plant()
        self.shown = OperatingPoints(
            samples["displacement_ratio"],
            samples["engine_speed"],
            samples["load_torque"],
            truth["oil_temperature"],
        )
        self.true = replace(self.shown, load_torque=truth["load_torque"])
        bare = self.bare = self.rows(plain, self.shown)
        others = [
            replace(plain, base=replace(plain.base, **{name: (1.0 + _STEP) * value}))
            for name, value in vars(plain.base).items()
            if not name.endswith("friction")
        ]
        gear = plain.train.gear_efficiency - _GEAR_LOSS
        others.append(replace(plain, train=replace(plain.train, gear_efficiency=gear)))
        columns = [self.rows(other, self.shown) - bare for other in others]
        count = len(self.true)
        columns += [np.zeros_like(bare) for _ in range(3)]
        columns[-3][:count] = _METER_GAIN * bare[:count]
        if "pressure" in samples:
            columns[-2][-count:] = _GAUGE[0] * bare[-count:]
            columns[-1][-count:] = _GAUGE[1] / pressure_noise(samples["pressure"])
        prior = np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
        self.absorbed, _ = np.linalg.qr(
            np.vstack([np.nan_to_num(np.transpose(columns)), prior])
        )

    def rows(self, plant: Plant, points: OperatingPoints) -> FloatArray:
        """Every reading without noise, in its deviations, one channel after another."""
        read = plant.read(points)
        channels = [read.efficiency / self.options.efficiency_noise]
        if self.options.output_speed_noise is not None:
            channels.append(np.log(read.output_speed) / self.options.output_speed_noise)
        if "pressure" in self.samples:
            channels.append(read.state[0] / pressure_noise(self.samples["pressure"]))
        return np.concatenate(channels)

    def alone(self, plant: Plant) -> FloatArray:
        """What a plant changes at the load that its meter shows."""
        off = plant.read(self.shown).load_torque - self.shown.load_torque
        return (
            self.rows(
                plant, replace(self.shown, load_torque=self.shown.load_torque - off)
            )
            - self.bare
        )

    def members(self, bench: Bench) -> list[FloatArray]:
        """What each effect of a bench changes beside the others."""
        whole = self.rows(bench.plant(*bench.effects), self.true)
        # An error of the output's meter moves the load at which everything else is read.
        return [
            whole
            - self.rows(
                bench.plant(*(other for other in bench.effects if other is not each)),
                self.shown if isinstance(each, TorqueSensor) else self.true,
            )
            for each in bench.effects
        ]

    def left(self, signs: Sequence[FloatArray]) -> FloatArray:
        """What a refit leaves of changes of the rows, one in each column."""
        padded = np.zeros((len(self.absorbed), len(signs)))
        padded[: len(signs[0])] = np.nan_to_num(np.transpose(signs))
        return np.asarray(padded - self.absorbed @ (self.absorbed.T @ padded))


def visible(campaign: Campaign) -> Visible:
    """Tell what of the effects in a campaign can be seen."""
    if not campaign.bench.effects:
        return Visible((), 0.0)
    look = _Look(campaign)
    left = look.left(look.members(campaign.bench))
    gram = left.T @ left
    cosines = gram**2 / np.outer(np.diag(gram), np.diag(gram)) - np.eye(len(gram))
    # Of each, what the others do not give as well: the Schur complement.
    return Visible(
        tuple((1.0 / np.diag(np.linalg.inv(gram))).tolist()), float(np.max(cosines))
    )


def beyond_others(campaign: Campaign) -> float:
    """Squared deviations that no other set of as many listed effects gives as well as the truth.

    Linearly: each effect in turn gives way to another, of several shapes, with the sign that it
    has, while the base, the errors of the bench and the sizes of the rest adapt.
    """
    bench, look, least = campaign.bench, _Look(campaign), np.inf
    others = [
        replace(draw_effect(name, np.random.default_rng(shape)), size=_SMALL)
        for name in KNOWN_EFFECTS
        if name not in bench.names
        for shape in range(_SHAPES)
    ]
    changes = look.left(
        [
            look.rows(bench.plant(*bench.effects), look.true) - look.bare,
            *map(look.alone, map(bench.plant, others)),
        ]
    )
    members = look.left(look.members(bench))
    for i in range(len(bench.effects)):
        rest, _ = np.linalg.qr(np.delete(members, i, axis=1))
        target, *ways = (changes - rest @ (rest.T @ changes)).T
        for other, way in zip(others, ways, strict=True):
            size = (
                way @ target / max(way @ way, 1e-300)
            )  # oil that stays as warm does nothing
            if size > 0.0 or (hasattr(other, "sense") and other.variant != "dead_band"):
                least = min(least, float(np.sum((target - size * way) ** 2)))
    return least
