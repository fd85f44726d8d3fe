# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What of the effects in a campaign can be seen, whatever is made of it."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from studies.blind.campaign import Campaign, pressure_noise
from studies.blind.effect import FloatArray
from studies.blind.meters import TorqueSensor
from studies.blind.twin import OperatingPoints, Plant

_STEP = 0.05  # relative, of each base parameter
# One deviation of the errors that no bench is free of; of the gauge: gain, and zero in Pa.
_METER_GAIN, _GEAR_LOSS, _GAUGE = 0.0015, 0.0005, (0.01, 1e5)


class Visible(NamedTuple):
    """Of each effect the squared deviations that it leaves, and how alike two effects look.

    `left` is over all channels, once the base parameters, the shared errors of a bench and the
    sizes of the other effects are refitted; `alike` the largest squared cosine between what two of
    them leave after the base alone.
    """

    left: tuple[float, ...]
    alike: float


def visible(campaign: Campaign) -> Visible:
    """Tell what of the effects in a campaign can be seen.

    Linear in the base parameters, with the plant itself in place of any model; with the true noise.
    """
    bench, samples, truth = campaign.bench, campaign.samples, campaign.truth
    effects, options, plain = bench.effects, bench.options, bench.plant()
    if not effects:
        return Visible((), 0.0)
    shown = OperatingPoints(samples["displacement_ratio"], samples["engine_speed"],
                            samples["load_torque"], truth["oil_temperature"])
    true = replace(shown, load_torque=truth["load_torque"])

    def rows(plant: Plant, points: OperatingPoints) -> FloatArray:
        read = plant.read(points)
        channels = [read.efficiency / options.efficiency_noise]
        if options.output_speed_noise is not None:
            channels.append(np.log(read.output_speed) / options.output_speed_noise)
        if "pressure" in samples:
            channels.append(read.state[0] / pressure_noise(samples["pressure"]))
        return np.concatenate(channels)

    bare = rows(plain, shown)
    others = [replace(plain, base=replace(plain.base, **{name: (1.0 + _STEP) * value}))
              for name, value in vars(plain.base).items() if not name.endswith("friction")]
    gear = plain.train.gear_efficiency - _GEAR_LOSS
    others.append(replace(plain, train=replace(plain.train, gear_efficiency=gear)))
    columns = [rows(other, shown) - bare for other in others]
    count = len(true)
    columns += [np.zeros_like(bare) for _ in range(3)]
    columns[-3][:count] = _METER_GAIN * bare[:count]
    if "pressure" in samples:
        columns[-2][-count:] = _GAUGE[0] * bare[-count:]
        columns[-1][-count:] = _GAUGE[1] / pressure_noise(samples["pressure"])
    prior = np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    absorbed, _ = np.linalg.qr(np.vstack([np.nan_to_num(np.transpose(columns)), prior]))
    # An error of the output's meter moves the load at which everything else is read.
    signs = rows(bench.plant(*effects), true)[:, None] - np.transpose([
        rows(bench.plant(*(other for other in effects if other is not each)),
             shown if isinstance(each, TorqueSensor) else true) for each in effects])
    signs = np.vstack([np.nan_to_num(signs), np.zeros((len(prior), len(effects)))])
    left = signs - absorbed @ (absorbed.T @ signs)
    gram = left.T @ left
    cosines = gram**2 / np.outer(np.diag(gram), np.diag(gram)) - np.eye(len(gram))
    # Of each, what the others do not give as well: the Schur complement.
    return Visible(tuple((1.0 / np.diag(np.linalg.inv(gram))).tolist()), float(np.max(cosines)))
