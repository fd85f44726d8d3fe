# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The oil of the bench: it warms with what is lost and cools with time."""

import numpy as np
import numpy.typing as npt

from studies.blind.bench.properties import Bench
from studies.blind.effect import FloatArray

#: Time constant of the tank with its cooler [s].
_TIME_CONSTANT = (900.0, 2700.0)
#: Ambient temperature [deg C], and temperature at which a session begins.
_AMBIENT = (15.0, 28.0)
_PREHEATED = (40.0, 55.0)
#: Mean temperature that a campaign settles to [deg C].
_SETTLED = (55.0, 75.0)
#: Films above the tank at the mean loss of the campaign [K].
_FILM_RISE = (2.0, 8.0)
#: Swing of the temperature where it is set at random [K].
_SWING = 20.0
_NOMINAL = 60.0


def temperatures(
    bench: Bench,
    lost_power: FloatArray,
    stamp: FloatArray,
    session: npt.NDArray[np.int_],
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Return temperatures of tank and films at each test [deg C].

    Args:
        bench: property `warming` counts.
        lost_power: of each test, in order [W].
        stamp: time of each test [s].
        session: number of its session.
        rng: of the oil.
    """
    time_constant = rng.uniform(*_TIME_CONSTANT)
    ambient = rng.uniform(*_AMBIENT)
    settled = rng.uniform(*_SETTLED)
    preheated = rng.uniform(*_PREHEATED)
    rise = rng.uniform(*_FILM_RISE)
    at_random = _NOMINAL + rng.uniform(-_SWING, _SWING, len(stamp))
    if not bench.warming:
        return at_random, at_random
    # A cooler takes more of a larger loss, so the level rises less than in proportion.
    level = ambient + (settled - ambient) * np.sqrt(lost_power / np.mean(lost_power))
    tank = np.empty(len(stamp))
    for number in range(len(stamp)):
        first = number == 0 or session[number] != session[number - 1]
        before = preheated if first else tank[number - 1]
        step = 300.0 if first else stamp[number] - stamp[number - 1]
        remaining = np.exp(-step / time_constant)
        tank[number] = level[number] + (before - level[number]) * remaining
    films = tank + rise * lost_power / np.mean(lost_power)
    return tank, films
