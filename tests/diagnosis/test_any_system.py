# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The diagnosis knows no transmission: a leaking hose of two axes goes through it unchanged."""

import ast
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from hmcvt_core import diagnosis
from hmcvt_core.diagnosis import diagnose_system, isolability
from hmcvt_core.diagnosis.observations import TRUST_STATED, Observations
from hmcvt_core.diagnosis.system import Axis, BaseParameters, Channel

NOISE = 0.05


class Hose(list):
    """Samples: the bench's own record, of which only the length and the source are asked."""

    source = "hose"

    def select(self, index):
        return Hose(self[i] for i in index)


@dataclass(frozen=True)
class Loss:
    """A loss that goes with a power of pressure and of speed, in one of the channels."""

    size: float = 0.0
    name: ClassVar[str] = ""
    form: ClassVar[str] = ""
    component: ClassVar[str] = "hose"
    prior: ClassVar[float] = 1.0
    summary: ClassVar[str] = "loses something"
    source: ClassVar[str] = "the test"
    remedy: ClassVar[str] = ""
    channel: ClassVar[int] = 0
    powers: ClassVar[tuple[float, float]] = (0.0, 0.0)

    def parameters(self):
        return [SimpleNamespace(name="size", unit="l/min", meaning="at 100 bar and 100 rad/s",
                                typical=1.0, low=0.0, high=20.0, grid=(), is_size=True)]

    sizes = parameters

    def values(self):
        return {"size": self.size}

    def with_values(self, values):
        return replace(self, **values)


class Burst(Loss):
    name, powers = "burst", (2.5, 0.0)


class Whirl(Loss):
    name, powers = "whirl", (0.0, 2.0)


class Rub(Loss):
    name, channel, powers = "rub", 1, (1.0, 1.0)


class Bench:
    axes = (Axis("pressure", "bar", "pressure", "pressure [bar]", 0, 0.5, told="{0:.0f} bar"),
            Axis("speed", "rad/s", "speed", "speed [rad/s]", 0, 0.1, told="{0:.0f} rad/s"))
    channels = tuple(Channel(name, unit, 1.0, 2, 0.05, False, (0.1, 0.4), (0.1, 0.4), 0.02)
                     for name, unit in (("flow_loss", "l/min"), ("torque_loss", "N m")))
    base = BaseParameters(("leak", "drag"), np.array([2.0, 3.0]), np.array([1.0, 1.0]),
                          np.zeros(2), np.full(2, 20.0), np.array)
    library = (Burst(), Whirl(), Rub())
    refusal, advice = "cannot be run", "look at the hose"

    def predict(self, base, effects, points):
        pressure, speed = points["pressure"] / 100.0, points["speed"] / 100.0
        rows = np.stack([base[0] * pressure + 0.5, base[1] * speed + 0.5])
        for effect in effects:
            p, q = effect.powers
            rows[effect.channel] += effect.size * pressure**p * speed**q
        return rows

    def candidates(self, points, base):
        grid = np.meshgrid([20.0, 150.0, 300.0], [20.0, 150.0, 300.0])
        return dict(zip(("pressure", "speed"), (axis.ravel() for axis in grid), strict=True))

    def lost_power(self, points, expected, real):
        return (real - expected) * points["pressure"] / 0.6  # l/min at bar in W

    def model_of(self, base, effects, samples):
        return base, effects

    def remarks(self, samples):
        return ("a hose",)


def hose(effects=(), n=60, read=2, bang=0.0):
    rng = np.random.default_rng(4)
    points = {"pressure": rng.uniform(20.0, 300.0, n), "speed": rng.uniform(20.0, 300.0, n)}
    true = Bench().predict(np.array([2.5, 2.0]), effects, points)
    true[0] += bang * ((points["speed"] > 140.0) & (points["speed"] < 180.0))
    measured = true[:read] + NOISE * rng.standard_normal((read, n))
    return Observations(Bench.axes, points, Bench.channels[:read], measured,
                        np.full((read, n), NOISE), np.full(read, TRUST_STATED), Hose(range(n)),
                        np.arange(n), "given")


def test_nothing_is_no_gap():
    found = diagnose_system(Bench(), hose())
    assert found.verdict == "no_gap"
    np.testing.assert_allclose(found.model[0], [2.5, 2.0], rtol=0.02)
    assert found.notes == ("a hose",)


@pytest.mark.parametrize("effect", [Burst(0.2), Whirl(0.3), Rub(0.3)], ids=lambda each: each.name)
def test_the_planted_effect_is_found(effect):
    found = diagnose_system(Bench(), hose((effect,)))
    assert found.verdict == "cause_found"
    assert found.causes[0].effect == effect.name
    assert found.component == "hose"
    assert found.model[1][0].size == pytest.approx(effect.size, rel=0.1)
    assert list(found.causes[0].drift) == ["leak", "drag"]
    data = found.to_dict()
    assert set(data["where"][0]) == {"pressure", "speed", "mean_residual", "samples", "p_value",
                                     "channel"}
    assert found.where[0].channel == Bench.channels[effect.channel].name
    text = found.report().replace("\n", " ")
    assert f"{effect.name} (" in text and "explains it" in text
    assert found.sets[0].effects == (effect.name,)
    assert "l/min" in text


def test_what_nobody_listed_is_placed():
    found = diagnose_system(Bench(), hose(bang=0.4))
    assert found.verdict == "unexplained"
    low, high = found.where[0].limits["speed"]
    assert (low, high) == pytest.approx((140.0, 180.0), abs=12.0)
    assert "The bench lies 0.3" in found.report()
    assert "l/min above the refitted model, mostly at medium speed." in found.report()


def test_a_channel_that_is_not_read_is_advised():
    found = isolability(Bench(), hose(read=1), np.array([2.0, 3.0]), hose())
    assert found.effects == ("burst", "whirl")
    assert found.further == "torque_loss"
    assert "noise of the flow loss: 0.05 l/min" in found.report()


def test_the_room_imports_nothing_of_a_transmission():
    for path in Path(diagnosis.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level != 1:
                assert node.level == 0 or (node.level, node.module) in (
                    (2, "errors"), (2, "files")), path
                assert not (node.module or "").startswith("hmcvt"), path
