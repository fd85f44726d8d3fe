# SPDX-License-Identifier: Apache-2.0
"""What the bench measured, channel by channel, with what is known of its noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files.bench import BenchSamples
from ..transmission.points import OperatingPoints
from ..transmission.ranges import BENCH_COLUMNS, EFFICIENCY_STD
from ..transmission.uncertainty import PAPER_EFFICIENCY_UNCERTAINTY
from .replicates import replicate_groups

Array = NDArray[np.float64]

OUTPUT_SPEED_UNCERTAINTY = 0.001
"""Relative noise taken for the output speed until the data tell better [-]."""

FEW = 16
"""Below this many samples scatter has no shape to be judged by; only its size is left."""

_TRUST_STATED, _TRUST_ASSUMED, _TRUST_FEW = 8.0, 1.0, 30.0
# Nobody stated the noise: weak enough that a bench twice as noisy raises no alarm at the size of
# its scatter, strong enough that one six times as noisy does.
_TRUST_FEW_ASSUMED = 3.0
_LEAST_DEVIATION = 1e-5
_REPLICATES_NEEDED = 5
_ASSUMED = "assumed, 1.12 % (paper, eq. (3))"


@dataclass(frozen=True, eq=False)
class Channel:
    """One measured quantity.

    Attributes:
        name: `efficiency` or `output_speed`.
        measured: shape (n,), in its unit.
        deviation: standard deviation stated or assumed, shape (n,), same unit.
        trust: how many samples the statement of `deviation` is worth; the data tell the rest.
    """

    name: str
    measured: Array
    deviation: Array
    trust: float


@dataclass(frozen=True, eq=False)
class Observations:
    """Channels at the operating points of n samples.

    Attributes:
        samples: the bench samples.
        channels: efficiency first.
        noise_source: where the noise of the efficiency comes from, in words.
        assumed: whether nobody stated it.
    """

    samples: BenchSamples
    channels: tuple[Channel, ...]
    noise_source: str
    assumed: bool = False

    @classmethod
    def of(cls, samples: BenchSamples, noise: float | None = None) -> Observations:
        """Set up the channels that the samples hold.

        Args:
            samples: bench samples.
            noise: standard deviation of the efficiency [-]; None takes `efficiency_std`, else
                repeated points, else the paper's 1.12 %.

        Raises:
            InputError: `noise` is out of range.
        """
        deviation, trust, source = stated_noise(samples, noise) or _assumed_noise(samples)
        assumed = source == _ASSUMED
        if len(samples) < FEW:
            # So few samples cannot correct a statement of noise: it has to be believed.
            trust = max(trust, _TRUST_FEW_ASSUMED if assumed else _TRUST_FEW)
        channels = [Channel("efficiency", samples.efficiency, deviation, trust)]
        if samples.output_speed is not None:
            channels.append(Channel("output_speed", samples.output_speed,
                                    OUTPUT_SPEED_UNCERTAINTY * samples.output_speed,
                                    _TRUST_ASSUMED))
        return cls(samples, tuple(channels), source, assumed)

    @property
    def points(self) -> OperatingPoints:
        """Operating points."""
        s = self.samples
        return OperatingPoints(s.displacement_ratio, s.engine_speed, s.load_torque,
                               s.oil_temperature)

    def whiten(self, predicted: Array) -> Array:
        """(Measured - predicted) / deviation; shapes (channels, n)."""
        return np.stack([(channel.measured - row) / channel.deviation
                         for channel, row in zip(self.channels, predicted, strict=True)])

    @property
    def scale(self) -> Array:
        """Deviations, shape (channels, n)."""
        return np.stack([channel.deviation for channel in self.channels])

    @property
    def trusts(self) -> Array:
        """Worth of the stated noise, shape (channels,)."""
        return np.array([channel.trust for channel in self.channels])

    def select(self, index: NDArray[np.intp]) -> Observations:
        """Return a subset of the samples, with the same noise."""
        channels = tuple(replace(channel, measured=channel.measured[index],
                                 deviation=channel.deviation[index]) for channel in self.channels)
        return Observations(self.samples.select(index), channels, self.noise_source, self.assumed)


def distinct_rows(samples: BenchSamples) -> NDArray[np.intp]:
    """Indices of the samples without those that copy an earlier one in every column.

    A copy says nothing new, least of all about the noise. Readings repeated at one point differ.
    """
    columns = [column for item in BENCH_COLUMNS
               if (column := getattr(samples, item.name)) is not None]
    rows = zip(*(column.tolist() for column in columns), *samples.extra.values(), strict=True)
    first: dict[tuple[object, ...], int] = {}
    for i, row in enumerate(rows):
        first.setdefault(row, i)
    return np.array(list(first.values()), dtype=np.intp)


def stated_noise(
    samples: BenchSamples, noise: float | None = None
) -> tuple[Array, float, str] | None:
    """Noise of the efficiency as the samples or the caller state it; None when neither does.

    Returns:
        Standard deviations of shape (n,) [-], how many samples the statement is worth, its source.

    Raises:
        InputError: `noise` is out of range.
    """
    if noise is not None:
        if noise == 0.0:
            raise InputError("noise = 0: no bench is exact; give the standard deviation of the "
                             f"efficiency, {EFFICIENCY_STD}")
        value = float(EFFICIENCY_STD.check(noise, "noise"))
        return np.full(len(samples), value), _TRUST_STATED, "given"
    if samples.efficiency_std is not None:
        return (np.maximum(samples.efficiency_std, _LEAST_DEVIATION), _TRUST_STATED,
                "column efficiency_std")
    pure = _pure_error(samples)
    if pure is not None:
        deviation, free = pure
        return np.full(len(samples), deviation), free, "repeated points"
    return None


def _assumed_noise(samples: BenchSamples) -> tuple[Array, float, str]:
    return PAPER_EFFICIENCY_UNCERTAINTY * samples.efficiency, _TRUST_ASSUMED, _ASSUMED


def _pure_error(samples: BenchSamples) -> tuple[float, float] | None:
    group = replicate_groups(samples)
    count = np.bincount(group)
    free = float(np.sum(count - 1))
    if free < _REPLICATES_NEEDED:
        return None
    mean = np.bincount(group, samples.efficiency) / count
    squares = float(np.sum((samples.efficiency - mean[group]) ** 2))
    deviation = float(np.sqrt(squares / free))
    # Readings do not agree so well: these are filled in, as in a plan, or copied.
    return (deviation, free) if deviation > _LEAST_DEVIATION else None
