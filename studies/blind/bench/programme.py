# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The programme of a campaign: which tests, in which order, in which sessions, at which time."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from studies.blind.bench.properties import Bench
from studies.blind.effect import FloatArray

PLANS = ("grid", "hyperbola", "sweep", "random")
_MAX_SESSIONS = 6
#: Duration of a test and of the gaps between sessions [s].
_TEST = (180.0, 420.0)
_GAP = (1.5 * 3600.0, 60.0 * 3600.0)
#: Relative scatter of a governor and of a dynamometer about their set points.
_SET_POINT = 0.002


@dataclass(frozen=True)
class Range:
    """Working range of one stage on the bench.

    Attributes:
        stroke: displacement ratio [-].
        speed: engine speed [rad/s].
        power: output power [W].
        torque: output power / engine speed [N m].
    """

    stroke: tuple[float, float]
    speed: tuple[float, float]
    power: tuple[float, float]
    torque: tuple[float, float]

    def load(self, speed: FloatArray, share: FloatArray) -> FloatArray:
        """Return load torque at a share of what the bench can ask for at a speed [N m]."""
        least = np.maximum(self.torque[0], self.power[0] / speed)
        most = np.minimum(self.torque[1], self.power[1] / speed)
        return np.asarray(least + (most - least) * share)


@dataclass(frozen=True)
class Programme:
    """Tests in the order in which they are made; arrays of shape (n,).

    Attributes:
        displacement_ratio: [-].
        engine_speed: [rad/s].
        load_torque: output power / engine speed [N m].
        stage: number of the stage.
        session: number of the session.
        stamp: end of the test [s].
    """

    displacement_ratio: FloatArray
    engine_speed: FloatArray
    load_torque: FloatArray
    stage: npt.NDArray[np.int_]
    session: npt.NDArray[np.int_]
    stamp: FloatArray

    def __len__(self) -> int:
        return len(self.stamp)


def draw_programme(
    bench: Bench,
    ranges: list[Range],
    tests: int,
    rng: np.random.Generator,
    order_rng: np.random.Generator,
) -> Programme:
    """Draw the tests of every stage, put them in order and into sessions.

    Args:
        bench: properties `plans`, `order` and `sessions` count.
        ranges: of each stage.
        tests: in all.
        rng: of the points.
        order_rng: of order, sessions and time.
    """
    kind = str(rng.choice(PLANS))
    if not bench.plans:
        kind = "random"
    counts = _split(tests, len(ranges))
    parts = []
    for number, (working, count) in enumerate(zip(ranges, counts, strict=True)):
        points = _POINTS[kind](working, count, rng)
        parts.append(np.vstack([points, np.full(count, float(number))]))
    stroke, speed, load, stage = np.hstack(parts)
    scatter = 1.0 + _SET_POINT * rng.standard_normal((2, tests))
    order = _order(stroke, speed, load, stage, order_rng)
    shuffled = order_rng.permutation(tests)
    if not bench.order:
        order = shuffled
    session, stamp = _sessions(tests, bench.sessions, order_rng)
    return Programme(
        displacement_ratio=stroke[order],
        engine_speed=(speed * scatter[0])[order],
        load_torque=(load * scatter[1])[order],
        stage=stage[order].astype(int),
        session=session,
        stamp=stamp,
    )


def fresh_programme(
    ranges: list[Range], tests: int, rng: np.random.Generator
) -> Programme:
    """Draw random tests of every stage, in no session."""
    alone = Bench(plans=False, sessions=False)
    programme = draw_programme(alone, ranges, tests, rng, rng)
    return replace(programme, session=np.zeros(tests, dtype=int))


# --- points -----------------------------------------------------------------------------------


def _between(limits: tuple[float, float], share: FloatArray) -> FloatArray:
    return np.asarray(limits[0] + (limits[1] - limits[0]) * share)


def _random(working: Range, count: int, rng: np.random.Generator) -> FloatArray:
    """Stroke, speed and load each evenly at random."""
    stroke, speed, load = rng.random((3, count))
    speed = _between(working.speed, speed)
    return np.stack(
        [_between(working.stroke, stroke), speed, working.load(speed, load)]
    )


def _grid(working: Range, count: int, rng: np.random.Generator) -> FloatArray:
    """A grid of speeds, loads and strokes, thinned out at random to the count."""
    speeds = int(rng.integers(3, 6))
    loads = int(rng.integers(3, 5))
    strokes = -(-count // (speeds * loads))
    nodes = np.meshgrid(
        np.linspace(0.0, 1.0, max(strokes, 2)),
        np.linspace(0.0, 1.0, speeds),
        np.linspace(0.0, 1.0, loads),
        indexing="ij",
    )
    stroke, speed, load = (axis.ravel() for axis in nodes)
    kept = np.sort(rng.permutation(len(stroke))[:count])
    speed = _between(working.speed, speed[kept])
    return np.stack(
        [
            _between(working.stroke, stroke[kept]),
            speed,
            working.load(speed, load[kept]),
        ]
    )


def _hyperbola(working: Range, count: int, rng: np.random.Generator) -> FloatArray:
    """Hyperbolas of constant power over speed, at a few strokes."""
    low, high = np.log(working.power)
    powers = np.exp(np.linspace(low, high, int(rng.integers(3, 5))))
    strokes = np.linspace(0.0, 1.0, int(rng.integers(5, 8)))
    speeds = -(-count // (len(powers) * len(strokes)))
    nodes = np.meshgrid(
        strokes, powers, np.linspace(0.0, 1.0, max(speeds, 2)), indexing="ij"
    )
    stroke, power, speed = (axis.ravel() for axis in nodes)
    kept = np.sort(rng.permutation(len(stroke))[:count])
    speed = _between(working.speed, speed[kept])
    load = np.clip(power[kept] / speed, *working.torque)
    return np.stack([_between(working.stroke, stroke[kept]), speed, load])


def _sweep(working: Range, count: int, rng: np.random.Generator) -> FloatArray:
    """Sweeps of stroke, each at one speed and one load."""
    sweeps = int(rng.integers(7, 13))
    sweeps = min(sweeps, count)
    lengths = _split(count, sweeps)
    held = rng.random((2, sweeps))
    # The corners belong to every plan that a person makes.
    corners = min(4, sweeps)
    held[:, :corners] = np.array([[0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]])[
        :, :corners
    ]
    parts = []
    for number, length in enumerate(lengths):
        speed = np.full(length, float(_between(working.speed, held[0, number])))
        load = working.load(speed, np.full(length, held[1, number]))
        stroke = _between(working.stroke, np.linspace(0.0, 1.0, length))
        parts.append(np.stack([stroke, speed, load]))
    return np.hstack(parts)


_POINTS = {
    "grid": _grid,
    "hyperbola": _hyperbola,
    "sweep": _sweep,
    "random": _random,
}


def _split(count: int, parts: int) -> list[int]:
    """Return sizes of parts that are as equal as possible."""
    small, larger = divmod(count, parts)
    return [small + 1] * larger + [small] * (parts - larger)


# --- order and time ---------------------------------------------------------------------------


def _order(
    stroke: FloatArray,
    speed: FloatArray,
    load: FloatArray,
    stage: FloatArray,
    rng: np.random.Generator,
) -> npt.NDArray[np.int_]:
    """Order by stage, then by speed or stroke in a few steps, then by the other and by load."""
    axes = [speed, stroke] if rng.random() < 0.5 else [stroke, speed]
    steps = []
    for axis in axes:
        low, high = np.min(axis), np.max(axis)
        share = (axis - low) / max(high - low, 1e-9)
        steps.append(np.round(5.0 * share))
    # Every other step goes back down, as one avoids long ways between tests.
    turned = np.where(steps[0] % 2.0 == 0.0, 1.0, -1.0)
    return np.lexsort([load, turned * steps[1], steps[0], stage])


def _sessions(
    tests: int, several: bool, rng: np.random.Generator
) -> tuple[npt.NDArray[np.int_], FloatArray]:
    """Return the session of each test, and the time at which it ends."""
    count = int(rng.integers(2, _MAX_SESSIONS + 1))
    share = rng.dirichlet(np.full(count, 6.0))
    duration = rng.uniform(*_TEST, tests)
    gaps = rng.uniform(*_GAP, count)
    session = np.zeros(tests, dtype=int)
    if several:
        ends = np.cumsum(share) * tests
        session = np.searchsorted(ends[:-1], np.arange(tests), side="right")
    before = np.concatenate([[0.0], np.cumsum(gaps)])[session]
    return session, np.cumsum(duration) + before
