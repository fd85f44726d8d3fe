# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A campaign on the renewed plant: what its meters show, and the truth behind it."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hmcvt_core.errors import InputError
from studies.blind.bench.campaign import draw_base, eased_load, lifted
from studies.blind.bench.layouts import Layout, Machine, settings_of
from studies.blind.bench.plant import Settings, State
from studies.blind.bench.programme import Programme, fresh_programme
from studies.blind.bench.truth import Hidden, sized
from studies.blind.effect import Effect, FloatArray
from studies.blind.renewed.day import Heat, clustered_programme
from studies.blind.renewed.listed import OWN_FORMS, FanDrive, ReliefValve
from studies.blind.renewed.meters import Meters, draw_meters, gauge_scatter
from studies.blind.renewed.transmissions import LAYOUTS
from studies.blind.renewed.unlisted import BASE_ERRORS, UNLISTED, Accessory

#: Version of the generator: equal versions and seeds give equal readings.
VERSION = 3
#: Kinds of campaign, with how often each occurs among all.
KINDS = {
    "single": 9,
    "pair": 5,
    "nothing": 3,
    "unlisted": 3,
    "triple": 2,
    "wrong_sign": 2,
    "base_off": 2,
    "accessory": 2,
}
SETS = {"single": 1, "pair": 2, "triple": 3}
#: Effects that may have the wrong sign, as a loss that the base overstates.
WRONG_SIGNS = ("pressure_leakage", "stroke_leakage", "churning", "output_churning")
#: Random streams of one seed.
_LAYOUT, _BASE, _PLAN, _HEAT, _EFFECTS, _ERRORS, _METERS, _NOISE, _COLUMNS, _FRESH = (
    range(10)
)
#: Base parameters against those served.
_BASE_FACTOR = (0.65, 1.5)
#: Shift of the efficiency by what is hidden, and by the errors of the base [-].
_SHIFTS = (0.005, 0.03)
_BASE_SHIFTS = (0.0005, 0.003)
#: Part of the campaigns with something hidden whose base errs.
_ERRING = 0.7
#: Parts of the campaigns that log pressure and oil temperature.
_PRESSURE = 0.5
_TEMPERATURE = 0.6


@dataclass(frozen=True)
class Truth:
    """The machine behind a campaign.

    Attributes:
        kind: of what it hides.
        plain: the machine without anything hidden and without errors of the base.
        effects: what is hidden.
        errors: by which the base differs from its form; empty where it is exact.
    """

    kind: str
    plain: Machine
    effects: tuple[Effect, ...]
    errors: tuple[Effect, ...]

    @property
    def base(self) -> Machine:
        """The machine without anything hidden, its own small losses included."""
        return replace(self.plain, effects=self.errors)

    @property
    def whole(self) -> Machine:
        """The machine as it runs."""
        return self.with_effects(*self.effects)

    def with_effects(self, *effects: Effect) -> Machine:
        """Return the base with other effects."""
        return replace(self.plain, effects=(*effects, *self.errors))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects, in order."""
        return tuple(sorted(effect.name for effect in self.effects))


@dataclass(frozen=True)
class Campaign:
    """What a bench shows, and what is behind it.

    Attributes:
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


def make_campaign(kind: str, seed: int, growth: float = 1.0) -> Campaign:
    """Draw a machine, hide something in it and measure it.

    Args:
        kind: one of `KINDS`.
        seed: equal seeds give equal machines and readings.
        growth: factor of the size of what is hidden.

    Raises:
        InputError: the machine stalls wherever it is loaded, or there is no such kind.
    """
    if kind not in KINDS:
        raise InputError(f"kind {kind!r} does not exist, expected one of {list(KINDS)}")
    plain = _draw_machine(seed)
    programme = clustered_programme(list(plain.layout.ranges), _stream(seed, _PLAN))
    settings = _warmed(plain, programme, seed)
    errors = _draw_errors(kind, plain, settings, programme, seed)
    state = plain.run(settings, programme.stage)
    rng = _stream(seed, _EFFECTS)
    effects = []
    for effect in _draw_effects(kind, rng):
        low, high = np.log(_SHIFTS)
        hidden = Hidden(
            _placed(effect, state, settings), float(np.exp(rng.uniform(low, high)))
        )
        effects.append(sized(plain, hidden, settings, programme.stage, growth))
    truth = Truth(kind, plain, tuple(effects), errors)
    settings = _eased(truth.whole, programme, settings)
    return _measured(truth, programme, settings, seed)


def without_errors(
    campaign: Campaign, base: bool = False, meters: bool = False
) -> Campaign:
    """Return the tests of a campaign, read again where errors are missing.

    Hidden effects, settings and scatter stay.

    Args:
        campaign: to read again.
        base: whether the base is exact.
        meters: whether the meters are exact but for their scatter.
    """
    truth = replace(campaign.truth, errors=()) if base else campaign.truth
    return _measured(
        truth, campaign.programme, campaign.settings, campaign.seed, exact_meters=meters
    )


def fresh_state(campaign: Campaign, tests: int) -> tuple[Programme, Settings, State]:
    """Return random tests of the same machine, without meters.

    The oil has temperatures of the campaign.
    """
    rng = _stream(campaign.seed, _FRESH)
    programme = fresh_programme(list(campaign.layout.ranges), tests, rng)
    picked = rng.integers(0, len(campaign.programme), tests)
    oil = campaign.settings.oil_temperature[picked]
    settings = settings_of(programme, oil, oil, np.zeros(tests))
    whole = campaign.truth.whole
    settings = _eased(whole, programme, settings)
    largest = float(np.max(campaign.state.output_torque))
    settings = lifted(settings, whole.run(settings, programme.stage), largest)
    return programme, settings, whole.run(settings, programme.stage)


def _stream(seed: int, number: int) -> np.random.Generator:
    return np.random.default_rng([seed, number, 97, VERSION])


def _draw_machine(seed: int) -> Machine:
    rng = _stream(seed, _LAYOUT)
    layout = LAYOUTS[rng.choice(len(LAYOUTS), p=[item.drawn for item in LAYOUTS])]
    base = draw_base(layout, _BASE_FACTOR, _stream(seed, _BASE))
    return Machine(layout, base)


def _draw_effects(kind: str, rng: np.random.Generator) -> list[Effect]:
    """Draw the effects of a kind of campaign, each of random shape."""
    if kind in SETS:
        names = rng.choice(sorted(OWN_FORMS), SETS[kind], replace=False)
        return [OWN_FORMS[str(name)]().drawn(rng) for name in names]
    if kind == "unlisted":
        return [UNLISTED[str(rng.choice(sorted(UNLISTED)))]().drawn(rng)]
    if kind == "wrong_sign":
        return [OWN_FORMS[str(rng.choice(WRONG_SIGNS))](size=-1.0).drawn(rng)]
    if kind == "accessory":
        return [Accessory()]
    return []


def _placed(effect: Effect, state: State, settings: Settings) -> Effect:
    """Return an effect whose threshold lies within what a campaign reaches."""
    if isinstance(effect, ReliefValve):
        cracking = np.nanquantile(np.abs(state.pressure), effect.quantile)
        return replace(effect, cracking=float(cracking))
    if isinstance(effect, FanDrive):
        return replace(
            effect, mean_temperature=float(np.mean(settings.oil_temperature))
        )
    return effect


def _draw_errors(
    kind: str, plain: Machine, settings: Settings, programme: Programme, seed: int
) -> tuple[Effect, ...]:
    """Draw two small losses of the base, or none."""
    rng = _stream(seed, _ERRORS)
    errs = rng.random() < _ERRING
    if kind == "nothing" or (kind != "base_off" and not errs):
        return ()
    errors = []
    for name in rng.choice(sorted(BASE_ERRORS), 2, replace=False):
        low, high = np.log(_BASE_SHIFTS)
        shift = float(np.exp(rng.uniform(low, high)))
        hidden = Hidden(BASE_ERRORS[str(name)]().drawn(rng), shift)
        errors.append(sized(plain, hidden, settings, programme.stage))
    return tuple(errors)


def _warmed(plain: Machine, programme: Programme, seed: int) -> Settings:
    """Return settings with the temperatures that the losses of the days make."""
    even = np.full(len(programme), 60.0)
    settings = settings_of(programme, even, even, np.zeros(len(programme)))
    settings = _eased(plain, programme, settings)
    state = plain.run(settings, programme.stage)
    settings = lifted(settings, state, float(np.max(state.output_torque)))
    settings = _eased(plain, programme, settings)
    state = plain.run(settings, programme.stage)
    engine_power = state.engine_torque * settings.engine_speed
    lost = engine_power * (1.0 - state.efficiency(settings.engine_speed))
    oil = Heat.drawn(_stream(seed, _HEAT)).temperatures(lost, programme.stamp)
    return replace(settings, oil_temperature=oil, film_temperature=oil)


def _eased(machine: Machine, programme: Programme, settings: Settings) -> Settings:
    """Return settings with loads that a machine carries; see `eased_load`."""
    load = eased_load(machine, programme, settings)
    return replace(settings, load_torque=load)


def _measured(
    truth: Truth,
    programme: Programme,
    settings: Settings,
    seed: int,
    exact_meters: bool = False,
) -> Campaign:
    """Read the meters of every test."""
    state = truth.whole.run(settings, programme.stage)
    session = programme.session
    meters = draw_meters(
        int(np.max(session)) + 1,
        state.engine_torque,
        state.output_torque,
        _stream(seed, _METERS),
    )
    if exact_meters:
        meters = meters.exact()
    oil = settings.oil_temperature
    engine = state.engine_torque
    output = state.output_torque
    for effect in truth.effects:
        engine, output = effect.read(engine, output)
    scatter = _stream(seed, _NOISE).standard_normal((6, len(programme)))
    engine = meters.engine.read(engine, session, oil)
    engine = engine + meters.engine.scatter * scatter[0]
    output = meters.output.read(output, session, oil)
    output = output + meters.output.scatter * scatter[1]
    speed = meters.speed_scatter
    engine_speed = settings.engine_speed * (1.0 + meters.engine_scale[session])
    engine_speed = engine_speed * (1.0 + speed * scatter[2])
    output_speed = state.output_speed * (1.0 + meters.output_scale[session])
    output_speed = output_speed * (1.0 + speed * scatter[3])
    power = output * output_speed
    efficiency = power / (engine * engine_speed)
    relative = np.sqrt(
        (meters.engine.scatter / engine) ** 2
        + (meters.output.scatter / output) ** 2
        + 2.0 * speed**2
    )
    noise = efficiency * relative
    columns = {
        "displacement_ratio": meters.stroke(settings.displacement_ratio, session),
        "engine_speed": engine_speed,
        "load_torque": power / engine_speed,
        "efficiency": efficiency,
        "output_speed": output_speed,
        "efficiency_std": noise,
        "stamp": programme.stamp,
    }
    pressure, temperature = _stream(seed, _COLUMNS).random(2)
    if pressure < _PRESSURE:
        shown = state.pressure * (1.0 + meters.gauge_gain[session])
        shown = shown + meters.gauge_zero[session]
        columns["pressure"] = shown + gauge_scatter(state.pressure) * scatter[4]
    needs_oil = {"oil_temperature", "fan_drive"} & set(truth.names)
    if temperature < _TEMPERATURE or needs_oil:
        columns["oil_temperature"] = oil + 0.5 * scatter[5]
    return Campaign(
        seed=seed,
        truth=truth,
        programme=programme,
        settings=settings,
        state=state,
        meters=meters,
        columns=columns,
        texts=_texts(truth.plain.layout, programme),
        noise=noise,
    )


def _texts(layout: Layout, programme: Programme) -> dict[str, tuple[str, ...]]:
    texts: dict[str, Any] = {
        "session": tuple(f"S{number + 1}" for number in programme.session)
    }
    if layout.names_stages:
        names = [train.name for train in layout.trains]
        texts["stage"] = tuple(names[number] for number in programme.stage)
    return texts
