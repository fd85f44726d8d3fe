# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A campaign on the bench: what the meters show, and the truth behind it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hmcvt_core.errors import InputError
from studies.blind.bench.layouts import LAYOUTS, Layout, Machine, settings_of
from studies.blind.bench.meters import (
    Meters,
    approach_of,
    draw_meters,
    elapsed_of,
    gauge_scatter,
)
from studies.blind.bench.oil import temperatures
from studies.blind.bench.plant import Settings, State
from studies.blind.bench.programme import (
    Programme,
    draw_programme,
    fresh_programme,
)
from studies.blind.bench.properties import Bench
from studies.blind.bench.texture import draw_texture
from studies.blind.bench.truth import draw_hidden, placed, sized
from studies.blind.effect import Effect, FloatArray
from studies.blind.twin import BaseTruth

TESTS = 96
#: Random streams of one seed: switching one property off leaves the others as they are.
_LAYOUT, _BASE, _PLAN, _ORDER, _OIL, _EFFECTS, _TEXTURE, _METERS, _NOISE, _COLUMNS = (
    range(10)
)
_FRESH = 10
#: Base parameters against those served, and texture of the base [efficiency].
_BASE_FACTOR = (0.6, 1.6)
_TEXTURE_SIZE = (0.0005, 0.0015)
_OFF_SIZE = (0.001, 0.002)
_PRESSURE_SHARE = 0.5
_TEMPERATURE_SHARE = 0.5
#: A test that stalls, or nearly, is made again at this share of its load.
_EASED = 0.8
_MAX_PRESSURE = 38e6
_MAX_EASINGS = 25
#: Smallest output torque of a test against the largest: below it, no meter is worth reading.
_MIN_TORQUE = 0.15


@dataclass(frozen=True)
class Truth:
    """The machine behind a campaign.

    Attributes:
        kind: of what it hides.
        plain: the machine without anything hidden.
        effects: what is hidden.
        texture: what its base form misses; empty where the base is exact.
    """

    kind: str
    plain: Machine
    effects: tuple[Effect, ...]
    texture: tuple[Effect, ...]

    @property
    def whole(self) -> Machine:
        """The machine as it runs."""
        return replace(self.plain, effects=(*self.effects, *self.texture))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects, in order."""
        return tuple(sorted(effect.name for effect in self.effects))

    def with_effects(self, *effects: Effect) -> Machine:
        """Return the machine with other effects, and its texture."""
        return replace(self.plain, effects=(*effects, *self.texture))


@dataclass(frozen=True)
class Campaign:
    """What a bench shows, and what is behind it.

    Attributes:
        bench: its properties.
        seed: of everything.
        truth: the machine.
        programme: tests in their order.
        settings: true settings of the tests.
        state: true state of the tests.
        meters: of the bench.
        columns: numbers as the bench file has them, by name, shape (n,).
        texts: columns of text.
        noise: standard deviation of each reading of efficiency, shape (n,).
    """

    bench: Bench
    seed: int
    truth: Truth
    programme: Programme
    settings: Settings
    state: State
    meters: Meters
    columns: dict[str, FloatArray]
    texts: dict[str, tuple[str, ...]]
    noise: FloatArray

    @property
    def layout(self) -> Layout:
        """The transmission on the bench."""
        return self.truth.plain.layout


def make_campaign(
    kind: str, seed: int, bench: Bench, tests: int = TESTS, growth: float = 1.0
) -> Campaign:
    """Draw a machine, hide something in it and measure it.

    Args:
        kind: one of `truth.KINDS`.
        seed: equal seeds give equal machines and readings.
        bench: properties of the bench.
        tests: number of tests.
        growth: factor of the size of what is hidden.

    Raises:
        InputError: the machine stalls wherever it is loaded, or there is no such kind.
    """
    layout = _draw_layout(bench, _stream(seed, _LAYOUT))
    plain = Machine(layout, draw_base(layout, _BASE_FACTOR, _stream(seed, _BASE)))
    programme = draw_programme(
        bench,
        list(layout.ranges),
        tests,
        _stream(seed, _PLAN),
        _stream(seed, _ORDER),
    )
    settings = _warmed(plain, programme, bench, seed)
    hidden = draw_hidden(kind, _stream(seed, _EFFECTS))
    state = plain.run(settings, programme.stage)
    effects = []
    for item in hidden:
        inside = replace(item, effect=placed(item.effect, state, settings))
        effects.append(sized(plain, inside, settings, programme.stage, growth))
    truth = Truth(kind, plain, tuple(effects), _draw_texture(kind, bench, seed))
    programme = _eased(truth.whole, programme, settings)
    settings = replace(settings, load_torque=programme.load_torque)
    return _measured(truth, programme, settings, bench, seed)


def fresh_state(campaign: Campaign, tests: int) -> tuple[Programme, Settings, State]:
    """Return random tests of the same machine, without meters.

    Tests at which the machine stalls are left out; the oil has temperatures of the campaign.
    """
    rng = _stream(campaign.seed, _FRESH)
    programme = fresh_programme(list(campaign.layout.ranges), tests, rng)
    picked = rng.integers(0, len(campaign.programme), tests)
    known = campaign.settings
    settings = settings_of(
        programme,
        known.oil_temperature[picked],
        known.film_temperature[picked],
        rng.choice([-1.0, 1.0], tests),
    )
    whole = campaign.truth.whole
    programme = _eased(whole, programme, settings)
    settings = replace(settings, load_torque=programme.load_torque)
    largest = float(np.max(campaign.state.output_torque))
    settings = lifted(settings, whole.run(settings, programme.stage), largest)
    return programme, settings, whole.run(settings, programme.stage)


def _stream(seed: int, number: int) -> np.random.Generator:
    return np.random.default_rng([seed, number, 41])


def _draw_layout(bench: Bench, rng: np.random.Generator) -> Layout:
    if not bench.layouts:
        return LAYOUTS[0]
    number = rng.choice(len(LAYOUTS), p=[layout.drawn for layout in LAYOUTS])
    return LAYOUTS[int(number)]


def draw_base(
    layout: Layout, limits: tuple[float, float], rng: np.random.Generator
) -> BaseTruth:
    """Draw base parameters, log-uniformly between limits relative to those that are served."""
    low, high = np.log(limits)
    factors = np.exp(rng.uniform(low, high, 3))
    served = layout.base
    return BaseTruth(
        float(served.leakage * factors[0]),
        float(served.motor_damping * factors[1]),
        float(served.pump_damping * factors[2]),
    )


def _draw_texture(kind: str, bench: Bench, seed: int) -> tuple[Effect, ...]:
    rng = _stream(seed, _TEXTURE)
    limits = _OFF_SIZE if kind == "base_off" else _TEXTURE_SIZE
    texture = draw_texture(float(rng.uniform(*limits)), rng)
    if kind == "nothing" or not bench.texture:
        return ()
    return (texture,)


def _warmed(plain: Machine, programme: Programme, bench: Bench, seed: int) -> Settings:
    """Settings with the temperatures that the losses of the plain machine make."""
    cold = np.full(len(programme), 60.0)
    approach = np.zeros(len(programme))
    settings = settings_of(programme, cold, cold, approach)
    eased = _eased(plain, programme, settings)
    settings = replace(settings, load_torque=eased.load_torque)
    state = plain.run(settings, programme.stage)
    largest = float(np.max(state.output_torque[state.runs]))
    settings = lifted(settings, state, largest)
    power = state.engine_torque * settings.engine_speed
    lost = power * (1.0 - state.efficiency(settings.engine_speed))
    lost = np.where(state.runs, lost, np.nanmean(lost))
    tank, films = temperatures(
        bench, lost, programme.stamp, programme.session, _stream(seed, _OIL)
    )
    approach = approach_of(settings.load_torque, programme.session)
    return replace(
        settings, oil_temperature=tank, film_temperature=films, approach=approach
    )


def lifted(settings: Settings, state: State, largest: float) -> Settings:
    """Raise loads whose output torque is too small a part of the largest to be measured."""
    short = _MIN_TORQUE * largest / state.output_torque
    return replace(settings, load_torque=settings.load_torque * np.maximum(short, 1.0))


def _eased(machine: Machine, programme: Programme, settings: Settings) -> Programme:
    """Return the plan with loads that a machine carries; see `eased_load`."""
    load = eased_load(machine, programme, settings)
    return replace(programme, load_torque=load)


def eased_load(
    machine: Machine, programme: Programme, settings: Settings
) -> FloatArray:
    """Return loads, lowered where a machine stalls or is close to it [N m], shape (n,).

    Raises:
        InputError: a test stalls at any load.
    """
    load = settings.load_torque.copy()
    pending = np.arange(len(programme))
    for _ in range(_MAX_EASINGS):
        tests = replace(settings, load_torque=load).select(pending)
        state = machine.run(tests, programme.stage[pending])
        stalls = ~state.runs | (np.abs(state.pressure) > _MAX_PRESSURE)
        pending = pending[stalls]
        if len(pending) == 0:
            return load
        load[pending] *= _EASED
    raise InputError(f"{len(pending)} test(s) stall at any load")


def _measured(
    truth: Truth, programme: Programme, settings: Settings, bench: Bench, seed: int
) -> Campaign:
    """Read the meters of every test."""
    state = truth.whole.run(settings, programme.stage)
    meters = draw_meters(
        bench, state.engine_torque, state.output_torque, _stream(seed, _METERS)
    )
    shown = readings(truth.whole, programme, settings, state, meters)
    rng = _stream(seed, _NOISE)
    scatter = rng.standard_normal((5, len(programme)))
    noise = _efficiency_noise(shown, meters)
    engine = shown["engine_torque"]
    output = shown["output_torque"]
    if bench.range_noise:
        engine = engine + meters.engine.scatter * scatter[0]
        output = output + meters.output.scatter * scatter[1]
    else:
        noise = np.full(len(noise), np.sqrt(np.mean(noise**2)))
        even = noise / shown["efficiency"]
        engine = engine * (1.0 - even * scatter[0])
    engine_speed = shown["engine_speed"] * (1.0 + meters.speed_scatter * scatter[2])
    output_speed = shown["output_speed"] * (1.0 + meters.speed_scatter * scatter[3])
    power = output * output_speed
    columns = {
        "displacement_ratio": settings.displacement_ratio,
        "engine_speed": engine_speed,
        "load_torque": power / engine_speed,
        "efficiency": power / (engine * engine_speed),
        "output_speed": output_speed,
    }
    if bench.record:
        columns["stamp"] = programme.stamp
    logs_oil = "oil_temperature" in truth.names
    columns.update(
        _optional_columns(shown, settings, noise, scatter[4], bench, seed, logs_oil)
    )
    return Campaign(
        bench=bench,
        seed=seed,
        truth=truth,
        programme=programme,
        settings=settings,
        state=state,
        meters=meters,
        columns=columns,
        texts=_texts(truth.plain.layout, programme, bench),
        noise=noise,
    )


def readings(
    machine: Machine,
    programme: Programme,
    settings: Settings,
    state: State,
    meters: Meters,
) -> dict[str, FloatArray]:
    """Return what the meters show without scatter, by name, shape (n,) each."""
    session = programme.session
    elapsed = elapsed_of(programme.stamp, session)
    engine = state.engine_torque
    output = state.output_torque
    for effect in machine.effects:
        engine, output = effect.read(engine, output)
    engine = meters.engine.read(engine, session, elapsed, approach_of(engine, session))
    output = meters.output.read(output, session, elapsed, approach_of(output, session))
    power = output * state.output_speed
    gain, zero = meters.gauge
    return {
        "engine_torque": engine,
        "output_torque": output,
        "engine_speed": settings.engine_speed,
        "output_speed": state.output_speed,
        "load_torque": power / settings.engine_speed,
        "efficiency": power / (engine * settings.engine_speed),
        "pressure": state.pressure * (1.0 + gain) + zero,
    }


def _efficiency_noise(shown: dict[str, FloatArray], meters: Meters) -> FloatArray:
    """Standard deviation of the efficiency from the scatter of the meters, shape (n,)."""
    engine = meters.engine.scatter / shown["engine_torque"]
    output = meters.output.scatter / shown["output_torque"]
    speeds = np.sqrt(2.0) * meters.speed_scatter
    relative = np.sqrt(engine**2 + output**2 + speeds**2)
    return np.asarray(shown["efficiency"] * relative)


def _optional_columns(
    shown: dict[str, FloatArray],
    settings: Settings,
    noise: FloatArray,
    scatter: FloatArray,
    bench: Bench,
    seed: int,
    logs_oil: bool,
) -> dict[str, FloatArray]:
    """Columns that not every bench has; the oil is logged where it is what is hidden."""
    pressure, temperature = _stream(seed, _COLUMNS).random(2)
    columns: dict[str, Any] = {}
    if bench.statement and np.all(noise > 0.0):
        columns["efficiency_std"] = noise
    if pressure < _PRESSURE_SHARE:
        deviation = gauge_scatter(shown["pressure"]) * bench.noise
        columns["pressure"] = shown["pressure"] + deviation * scatter
    if (bench.temperature and temperature < _TEMPERATURE_SHARE) or logs_oil:
        columns["oil_temperature"] = settings.oil_temperature
    return columns


def _texts(
    layout: Layout, programme: Programme, bench: Bench
) -> dict[str, tuple[str, ...]]:
    texts = {}
    if bench.record:
        texts["session"] = tuple(f"S{number + 1}" for number in programme.session)
    if layout.names_stages:
        names = [train.name for train in layout.trains]
        texts["stage"] = tuple(names[number] for number in programme.stage)
    return texts
