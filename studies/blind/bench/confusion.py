# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What of the hidden effects the readings show, and whether another effect imitates them.

Linear, with the plant itself in place of any model. The base parameters are free; the errors that
no bench is free of have the deviations that they really have: zero, gain and drift of either torque
meter in each session, hysteresis, gauge, gears, and the texture of the base.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from studies.blind.bench.campaign import Campaign
from studies.blind.bench.classes import class_of
from studies.blind.bench.layouts import Machine
from studies.blind.bench.listed_losses import LISTED_LOSSES
from studies.blind.bench.meters import approach_of, elapsed_of, gauge_scatter
from studies.blind.bench.texture import Field, Texture
from studies.blind.bench.trains import Train
from studies.blind.catalogue import KNOWN_EFFECTS, draw_effect
from studies.blind.effect import Effect, FloatArray

#: Relative step of a base parameter.
_STEP = 0.05
#: One deviation of the efficiency of gear pairs, and of the gauge: gain, zero [Pa].
_GEAR_LOSS = 0.0005
_GAUGE = (0.005, 5e4)
_DRIFT = 0.0003 / np.sqrt(3.0)
#: Relative deviation of a ratio of speeds where the bench has no scatter, and of the efficiency.
_MIN_SPEED = 2e-5
_MIN_EFFICIENCY = 1e-5
#: Square below which an effect leaves nothing.
_MIN_SQUARE = 1e-12
#: Shapes of each listed effect that may imitate, and their size.
_SHAPES = 4
_SMALL = 0.1


@dataclass(frozen=True)
class Confusion:
    """What of the hidden effects the readings show.

    Attributes:
        left: squared deviations that each effect leaves, once everything else is refitted.
        alike: largest squared cosine between what two of them leave.
        beyond: squared deviations that no other set of as many listed effects imitates; None where
            nothing is hidden.
    """

    left: tuple[float, ...]
    alike: float
    beyond: float | None


def confusion_of(campaign: Campaign) -> Confusion:
    """Return what of the hidden effects of a campaign can be seen."""
    if not campaign.truth.effects:
        return Confusion((), 0.0, None)
    look = _Look(campaign)
    members = look.remaining(look.members())
    gram = members.T @ members
    scale = np.sqrt(np.outer(np.diag(gram), np.diag(gram)))
    cosines = (gram / np.maximum(scale, _MIN_SQUARE)) ** 2
    np.fill_diagonal(cosines, 0.0)
    left = tuple(_left_of(members, i) for i in range(len(gram)))
    return Confusion(left, float(np.max(cosines)), look.beyond(members))


def _left_of(members: FloatArray, i: int) -> float:
    """Return the square of one effect that the other effects do not give as well."""
    others = np.delete(members, i, axis=1)
    shares, *_ = np.linalg.lstsq(others, members[:, i], rcond=None)
    return float(np.sum((members[:, i] - others @ shares) ** 2))


class _Look:
    """Readings of a campaign in their deviations, and what errors of the bench absorb."""

    def __init__(self, campaign: Campaign) -> None:
        self.campaign = campaign
        self.plain = replace(campaign.truth.plain, effects=())
        self.efficiency_sd = np.maximum(campaign.noise, _MIN_EFFICIENCY)
        scatter = np.sqrt(2.0) * campaign.meters.speed_scatter
        self.speed_sd = max(scatter, _MIN_SPEED)
        self.has_pressure = "pressure" in campaign.columns
        self.bare = self.rows(self.plain)
        columns = [*self._free(), *self._uncertain()]
        count = len(self._free_names())
        prior = np.eye(len(columns))
        prior[:count] = 0.0
        stacked = np.vstack([np.transpose(columns), prior])
        self.absorbed, _ = np.linalg.qr(np.nan_to_num(stacked))

    # --- readings -----------------------------------------------------------------------------

    def rows(self, machine: Machine, load: FloatArray | None = None) -> FloatArray:
        """Return every reading of a machine without meters' errors, in its deviations.

        Args:
            machine: to run.
            load: true load torque, where it is not that of the campaign [N m].
        """
        campaign = self.campaign
        settings = campaign.settings
        if load is not None:
            settings = replace(settings, load_torque=load)
        state = machine.run(settings, campaign.programme.stage)
        engine = state.engine_torque
        output = state.output_torque
        for effect in machine.effects:
            engine, output = effect.read(engine, output)
        power = output * state.output_speed
        efficiency = power / (engine * settings.engine_speed)
        channels = [
            efficiency / self.efficiency_sd,
            np.log(np.maximum(state.output_speed, 1.0)) / self.speed_sd,
        ]
        if self.has_pressure:
            pressure = campaign.state.pressure
            channels.append(state.pressure / gauge_scatter(pressure))
        return np.nan_to_num(np.concatenate(channels))

    def effect_of(self, effect: Effect) -> FloatArray:
        """Return what an effect alone changes, at the load that the meters show."""
        machine = replace(self.plain, effects=(effect,))
        if type(effect).read is Effect.read:
            return self.rows(machine) - self.bare
        # An error of the output's meter moves the load at which everything else is read.
        settings = self.campaign.settings
        state = self.campaign.state
        _, output = effect.read(state.engine_torque, state.output_torque)
        ratio = state.output_torque / output
        return self.rows(machine, settings.load_torque * ratio) - self.bare

    def members(self) -> list[FloatArray]:
        """Return what each hidden effect changes."""
        return [self.effect_of(effect) for effect in self.campaign.truth.effects]

    def remaining(self, changes: Sequence[FloatArray]) -> FloatArray:
        """Return what base and errors of the bench do not absorb; a change in each column."""
        padded = np.zeros((len(self.absorbed), len(changes)))
        padded[: len(self.bare)] = np.transpose(changes)
        return np.asarray(padded - self.absorbed @ (self.absorbed.T @ padded))

    # --- what absorbs -------------------------------------------------------------------------

    def _free_names(self) -> tuple[str, ...]:
        return ("leakage", "motor_damping", "pump_damping")

    def _free(self) -> list[FloatArray]:
        """Changes by the base parameters."""
        columns = []
        for name in self._free_names():
            value = (1.0 + _STEP) * getattr(self.plain.base, name)
            other = replace(self.plain, base=replace(self.plain.base, **{name: value}))
            columns.append(self.rows(other) - self.bare)
        return columns

    def _uncertain(self) -> list[FloatArray]:
        """Changes by one deviation of every error of the bench."""
        trains = tuple(_with_gear_loss(t) for t in self.plain.layout.trains)
        layout = replace(self.plain.layout, trains=trains)
        columns = [self.rows(replace(self.plain, layout=layout)) - self.bare]
        columns += self._meter_columns()
        columns += self._texture_columns()
        if self.has_pressure:
            pressure = self.campaign.state.pressure
            deviation = gauge_scatter(pressure)
            for shape in (_GAUGE[0] * pressure, np.full(len(pressure), _GAUGE[1])):
                columns.append(self._channel(2, shape / deviation))
        return columns

    def _channel(self, number: int, values: FloatArray) -> FloatArray:
        column = np.zeros_like(self.bare)
        count = len(values)
        column[number * count : (number + 1) * count] = values
        return column

    def _meter_columns(self) -> list[FloatArray]:
        campaign = self.campaign
        session = campaign.programme.session
        elapsed = elapsed_of(campaign.programme.stamp, session)
        state = campaign.state
        efficiency = state.efficiency(campaign.settings.engine_speed)
        columns = []
        for meter, torque, sign in (
            (campaign.meters.engine, state.engine_torque, -1.0),
            (campaign.meters.output, state.output_torque, 1.0),
        ):
            relative = sign * efficiency / torque / self.efficiency_sd
            drift = _DRIFT * meter.full_scale * campaign.bench.drift
            approach = approach_of(torque, session)
            columns.append(
                self._channel(0, 0.5 * meter.hysteresis * approach * relative)
            )
            for number in range(int(np.max(session)) + 1):
                inside = session == number
                shapes = (
                    meter.zero_sd * np.ones_like(torque),
                    meter.gain_sd * torque,
                    drift * elapsed,
                    drift * np.sin(np.pi * elapsed),
                )
                for shape in shapes:
                    columns.append(self._channel(0, shape * relative * inside))
        return columns

    def _texture_columns(self) -> list[FloatArray]:
        """Changes by one deviation of each feature of the texture."""
        columns = []
        settings = self.campaign.settings
        for texture in self.campaign.truth.texture:
            if not isinstance(texture, Texture):
                continue
            for name in ("torque", "flow"):
                field = getattr(texture, name)
                features = field.features(
                    self.plain.layout.trains[0].sense * settings.displacement_ratio,
                    settings.engine_speed,
                    settings.load_torque,
                )
                # Tests do not influence each other, so one run serves all features.
                response = self.effect_of(_even(texture, name))
                channels = len(response) // len(features)
                for feature in features.T:
                    columns.append(response * np.tile(feature, channels))
        return columns

    # --- imitation ----------------------------------------------------------------------------

    def beyond(self, members: FloatArray) -> float:
        """Return the squared deviations that no other set of as many effects imitates.

        Each effect in turn gives way to another one, of several shapes, with the sign that it has,
        while base, errors of the bench and sizes of the rest adapt.

        Args:
            members: what remains of each hidden effect, one in each column.
        """
        hidden = self.campaign.truth.effects
        others = self._others()
        whole = np.sum(members, axis=1)
        ways = self.remaining([self.effect_of(other) for other in others])
        least = float("inf")
        for i in range(len(hidden)):
            rest, _ = np.linalg.qr(np.delete(members, i, axis=1))
            target = whole - rest @ (rest.T @ whole)
            projected = ways - rest @ (rest.T @ ways)
            for other, way in zip(others, projected.T, strict=True):
                size = way @ target / max(way @ way, 1e-300)
                if size > 0.0 or _has_either_sign(other):
                    missed = target - size * way
                    least = min(least, float(missed @ missed))
        return least

    def _others(self) -> list[Effect]:
        """Listed effects of another class than those hidden, of several shapes."""
        hidden = {self._class_of(effect) for effect in self.campaign.truth.effects}
        others = []
        for name in KNOWN_EFFECTS:
            for shape in range(_SHAPES):
                rng = np.random.default_rng(shape)
                effect = draw_effect(name, rng)
                if shape % 2:
                    effect = LISTED_LOSSES[name]().drawn(rng)
                if self._class_of(effect) not in hidden:
                    others.append(replace(effect, size=_SMALL))
        return others

    def _class_of(self, effect: Effect) -> str:
        output_coupled = self.campaign.layout.output_coupled
        return class_of(effect.name, effect.variant, output_coupled)


def _even(texture: Texture, name: str) -> Texture:
    """Return a texture with one of its two fields alone, of the value one everywhere."""
    if name == "torque":
        return replace(texture, torque=Field.even(), flow=None)
    return replace(texture, torque=None, flow=Field.even())


def _with_gear_loss(train: Train) -> Train:
    """Return a train whose pairs lose a little more."""
    paths = {}
    for name in ("mechanical", "pump", "motor", "output"):
        path = getattr(train, name)
        paths[name] = replace(path, efficiency=path.efficiency - _GEAR_LOSS)
    return replace(train, **paths)


def _has_either_sign(effect: Effect) -> bool:
    return hasattr(effect, "sense") and effect.variant != "dead_band"
