# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Days on the bench: clustered tests, their times, and the heat that a day brings."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from studies.blind.bench.programme import Programme, Range
from studies.blind.effect import FloatArray

#: Numbers of tests of a campaign.
TESTS = (8, 12, 16, 24, 32, 48, 64, 96)
_CLUSTERS = (3, 9)
#: Half width of a cluster, in parts of each axis.
_SPREAD = (0.02, 0.15)
#: Part of the tests that are made alone, away from every cluster.
_STRAY = (0.05, 0.3)
#: Duration of a test, and of a day's pause [s].
_TEST = (240.0, 560.0)
_BREAK = (2400.0, 5400.0)
_DAY = 86400.0
_MAX_SESSIONS = 6
#: Fewest tests of a session.
_MIN_TESTS = 4
#: Step of the thermal state [s].
_STEP = 30.0


def clustered_programme(ranges: list[Range], rng: np.random.Generator) -> Programme:
    """Draw tests in clusters, as a machine in use is tested, and spread them over days.

    Args:
        ranges: working range of each stage.
        rng: of everything.
    """
    tests = int(rng.choice(TESTS))
    clusters = min(int(rng.integers(*_CLUSTERS)), max(3, tests // 2))
    middles = (rng.permuted(np.tile(np.arange(clusters), (3, 1)), axis=1) + 0.5).T
    middles = middles / clusters
    stages = np.arange(clusters) % len(ranges)
    member = np.sort(rng.integers(0, clusters, tests))
    spread = rng.uniform(*_SPREAD)
    places = middles[member] + spread * rng.standard_normal((tests, 3))
    stray = rng.random(tests) < rng.uniform(*_STRAY)
    places[stray] = rng.random((int(np.sum(stray)), 3))
    places = np.clip(places, 0.0, 1.0)
    stage = stages[member]
    stroke = np.empty(tests)
    speed = np.empty(tests)
    load = np.empty(tests)
    for number, working in enumerate(ranges):
        inside = stage == number
        stroke[inside] = _between(working.stroke, places[inside, 0])
        speed[inside] = _between(working.speed, places[inside, 1])
        load[inside] = working.load(speed[inside], places[inside, 2])
    # Half of the campaigns come back to their clusters on other days.
    if rng.random() < 0.5:
        order = rng.permutation(tests)
        stroke = stroke[order]
        speed = speed[order]
        load = load[order]
        stage = stage[order]
    session, stamp = _days(tests, rng)
    return Programme(stroke, speed, load, stage, session, stamp)


def _between(limits: tuple[float, float], share: FloatArray) -> FloatArray:
    return np.asarray(limits[0] + (limits[1] - limits[0]) * share)


def _days(
    tests: int, rng: np.random.Generator
) -> tuple[npt.NDArray[np.int_], FloatArray]:
    """Return the session of each test, and the time at which it ends [s].

    A day has one session, or two with a pause at noon.
    """
    most = min(_MAX_SESSIONS, tests // _MIN_TESTS)
    sessions = int(rng.integers(1, most + 1))
    session = (np.arange(tests) * sessions) // tests
    starts = []
    clock = 7.5 * 3600.0
    day = 0
    for number in range(sessions):
        in_afternoon = number % 2 == 1 and rng.random() < 0.5
        if number > 0 and not in_afternoon:
            day += int(rng.integers(1, 4))
            clock = rng.uniform(7.0, 9.0) * 3600.0
        if in_afternoon:
            clock += rng.uniform(*_BREAK)
        starts.append(day * _DAY + clock)
        count = int(np.sum(session == number))
        clock += count * float(np.mean(_TEST))
    duration = rng.uniform(*_TEST, tests)
    stamp = np.empty(tests)
    for number, start in enumerate(starts):
        inside = session == number
        stamp[inside] = start + np.cumsum(duration[inside])
    return session, stamp


@dataclass(frozen=True)
class Heat:
    """Thermal state of a bench: oil and casing, an ambient that follows the day, a cooler.

    Attributes:
        oil, casing: heat capacities [J/K].
        exchange: between oil and casing [W/K].
        ambient_loss: from casing to ambient [W/K].
        cooler: from oil to ambient above the thermostat [W/K].
        thermostat: [deg C].
        ambient: mean of the day [deg C].
        swing: of the ambient over a day [K].
    """

    oil: float
    casing: float
    exchange: float
    ambient_loss: float
    cooler: float
    thermostat: float
    ambient: float
    swing: float

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> "Heat":
        """Draw a bench."""
        return cls(
            oil=float(rng.uniform(6e4, 1.6e5)),
            casing=float(rng.uniform(1.5e5, 4e5)),
            exchange=float(rng.uniform(200.0, 600.0)),
            ambient_loss=float(rng.uniform(40.0, 150.0)),
            cooler=float(rng.uniform(300.0, 1200.0)),
            thermostat=float(rng.uniform(50.0, 70.0)),
            ambient=float(rng.uniform(8.0, 26.0)),
            swing=float(rng.uniform(2.0, 7.0)),
        )

    def temperatures(self, lost_power: FloatArray, stamp: FloatArray) -> FloatArray:
        """Return the temperature of the oil at the end of each test [deg C], shape (n,).

        Args:
            lost_power: of each test, in order [W].
            stamp: end of each test [s].
        """
        oil = self._ambient_at(stamp[0])
        casing = oil
        before = stamp[0] - 1200.0  # warm-up before the first test
        shown = np.empty(len(stamp))
        for number, end in enumerate(stamp):
            gap = end - before
            idle = max(0.0, gap - _TEST[1])
            if idle > 0.0 and number > 0:
                oil, casing = self._run(oil, casing, 0.0, before, idle)
            oil, casing = self._run(
                oil, casing, float(lost_power[number]), end - (gap - idle), gap - idle
            )
            shown[number] = oil
            before = end
        return shown

    def _ambient_at(self, time: float) -> float:
        hour = 2.0 * np.pi * (time / _DAY - 10.0 / 24.0)
        return float(self.ambient + self.swing * np.sin(hour))

    def _run(
        self, oil: float, casing: float, heat: float, start: float, duration: float
    ) -> tuple[float, float]:
        """Integrate the two temperatures over a time at constant heat."""
        steps = max(1, int(np.ceil(duration / _STEP)))
        step = duration / steps
        for number in range(steps):
            ambient = self._ambient_at(start + number * step)
            cooled = self.cooler * max(0.0, oil - self.thermostat)
            passed = self.exchange * (oil - casing)
            lost = self.ambient_loss * (casing - ambient)
            oil += step * (heat - cooled - passed) / self.oil
            casing += step * (passed - lost) / self.casing
        return oil, casing
