# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Readings of a campaign in their deviations, and what base and meters absorb of a change.

The plant itself takes the place of any model. Base parameters are free; errors of every meter have
the deviations from which they are drawn. The errors of the base are known: they are in the machine.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from studies.blind.bench.layouts import Machine
from studies.blind.bench.plant import Settings
from studies.blind.effect import Effect, FloatArray
from studies.blind.renewed.campaign import Campaign
from studies.blind.renewed.meters import gauge_deviation, gauge_scatter

#: Relative step of a base parameter, and of stroke, load and speed.
_STEP = 0.05
_SMALL_STEP = 1e-3
_MIN_SQUARE = 1e-12

IntArray = npt.NDArray[np.int_]


@dataclass(frozen=True)
class Visibility:
    """What of the hidden effects the readings show.

    Attributes:
        left: squared deviations that each effect leaves, once everything else is refitted.
        alike: largest squared cosine between what two of them leave.
    """

    left: tuple[float, ...]
    alike: float


class Look:
    """Whitened readings of one campaign, and the space that base and meters absorb."""

    def __init__(self, campaign: Campaign) -> None:
        self.campaign = campaign
        self.base = campaign.truth.base
        self.settings = self._shown_settings()
        self.efficiency_deviation = campaign.noise
        self.speed_deviation = np.sqrt(2.0) * campaign.meters.speed_scatter
        self.has_pressure = "pressure" in campaign.columns
        self.bare = self.rows(self.base)
        columns = np.transpose([*self._free(), *self._meter_columns()])
        prior = np.eye(columns.shape[1])
        prior[:3] = 0.0  # the base parameters have no prior
        self.absorbed, _ = np.linalg.qr(np.vstack([columns, prior]))

    # --- readings -----------------------------------------------------------------------------

    def _shown_settings(self) -> Settings:
        """Return the settings that the meters show; the oil is known."""
        columns = self.campaign.columns
        return replace(
            self.campaign.settings,
            displacement_ratio=columns["displacement_ratio"],
            engine_speed=columns["engine_speed"],
            load_torque=columns["load_torque"],
        )

    def observed(self) -> FloatArray:
        """Return every reading in its deviations, shape (rows,)."""
        return self._whitened(
            self.campaign.columns["efficiency"],
            self.campaign.columns["output_speed"],
            self.campaign.columns.get("pressure"),
        )

    def rows(self, machine: Machine, settings: Settings | None = None) -> FloatArray:
        """Return every reading of a machine without errors of meters, in its deviations.

        Args:
            machine: to run.
            settings: of the tests; those shown where None.
        """
        at = self.settings if settings is None else settings
        # A meter that an effect puts out of true shows another load than the true one.
        for _ in range(2):
            state = machine.run(at, self.campaign.programme.stage)
            engine, output = state.engine_torque, state.output_torque
            for effect in machine.effects:
                engine, output = effect.read(engine, output)
            if np.array_equal(output, state.output_torque):
                break
            wanted = self.settings if settings is None else settings
            ratio = np.clip(state.output_torque / output, 0.5, 2.0)
            at = replace(at, load_torque=wanted.load_torque * ratio)
        power = output * state.output_speed
        efficiency = power / (engine * at.engine_speed)
        return self._whitened(efficiency, state.output_speed, state.pressure)

    def _whitened(
        self,
        efficiency: FloatArray,
        output_speed: FloatArray,
        pressure: FloatArray | None,
    ) -> FloatArray:
        channels = [
            efficiency / self.efficiency_deviation,
            np.log(np.maximum(output_speed, 1.0)) / self.speed_deviation,
        ]
        if self.has_pressure and pressure is not None:
            deviation = gauge_scatter(self.campaign.state.pressure)
            channels.append(pressure / deviation)
        return np.nan_to_num(np.concatenate(channels))

    def change(self, effects: Sequence[Effect]) -> FloatArray:
        """Return what effects change in the readings of the base."""
        return self.rows(self.campaign.truth.with_effects(*effects)) - self.bare

    def remaining(self, changes: FloatArray) -> FloatArray:
        """Return what base and meters do not absorb of changes, one a column."""
        changes = np.atleast_2d(np.transpose(changes)).T
        padded = np.zeros((len(self.absorbed), changes.shape[1]))
        padded[: len(self.bare)] = changes
        return np.asarray(padded - self.absorbed @ (self.absorbed.T @ padded))

    # --- what absorbs -------------------------------------------------------------------------

    def _free(self) -> list[FloatArray]:
        """Changes by the base parameters."""
        columns = []
        for name in ("leakage", "motor_damping", "pump_damping"):
            value = (1.0 + _STEP) * getattr(self.base.base, name)
            base = replace(self.base.base, **{name: value})
            columns.append(self.rows(replace(self.base, base=base)) - self.bare)
        return columns

    def _meter_columns(self) -> list[FloatArray]:
        """Changes by one deviation of every error of the meters."""
        campaign = self.campaign
        session = campaign.programme.session
        oil = campaign.settings.oil_temperature
        state = campaign.state
        relative = campaign.columns["efficiency"] / self.efficiency_deviation
        columns = []
        by_load = self._slope("load_torque")
        for error in campaign.meters.engine.columns(state.engine_torque, session, oil):
            columns.append(self._channel(0, -relative * error / state.engine_torque))
        for error in campaign.meters.output.columns(state.output_torque, session, oil):
            part = error / state.output_torque
            shown = self._channel(0, relative * part)
            columns.append(
                shown - self._tiled(campaign.settings.load_torque * part) * by_load
            )
        columns += self._stroke_columns(session)
        columns += self._speed_columns(session, relative, by_load)
        if self.has_pressure:
            columns += self._gauge_columns(session)
        return columns

    def _stroke_columns(self, session: IntArray) -> list[FloatArray]:
        """Changes by scale and zero of the stroke sensor."""
        slope = self._slope("displacement_ratio")
        deviation = self.campaign.meters.stroke_deviation
        columns = []
        for number in np.unique(session):
            inside = session == number
            for error in (self.settings.displacement_ratio * inside, 1.0 * inside):
                columns.append(-self._tiled(deviation * error) * slope)
        return columns

    def _speed_columns(
        self, session: IntArray, relative: FloatArray, by_load: FloatArray
    ) -> list[FloatArray]:
        """Changes by the scales of the speed meters."""
        deviation = self.campaign.meters.speed_deviation
        load = self.settings.load_torque
        by_speed = self._slope("engine_speed")
        columns = []
        for number in np.unique(session):
            part = deviation * (session == number)
            # The engine's speed stands in the efficiency and below the load torque.
            engine = self._channel(0, -relative * part)
            engine = engine + self._tiled(load * part) * by_load
            engine = engine - self._tiled(self.settings.engine_speed * part) * by_speed
            output = self._channel(0, relative * part)
            output = output + self._channel(1, part / self.speed_deviation)
            columns += [engine, output - self._tiled(load * part) * by_load]
        return columns

    def _gauge_columns(self, session: IntArray) -> list[FloatArray]:
        """Changes by gain and zero of the gauge."""
        pressure = self.campaign.state.pressure
        deviation = gauge_scatter(pressure)
        gain, zero = gauge_deviation()
        columns = []
        for number in np.unique(session):
            inside = session == number
            for error in (gain * pressure * inside, zero * inside):
                columns.append(self._channel(2, error / deviation))
        return columns

    def _slope(self, name: str) -> FloatArray:
        """Change of the readings by one unit of a setting, shape (rows,)."""
        values = getattr(self.settings, name)
        step = _SMALL_STEP * np.maximum(np.abs(values), 0.5)
        moved = replace(self.settings, **{name: values + step})
        return (self.rows(self.base, moved) - self.bare) / self._tiled(step)

    def _tiled(self, values: FloatArray) -> FloatArray:
        return np.tile(values, len(self.bare) // len(values))

    def _channel(self, number: int, values: FloatArray) -> FloatArray:
        column = np.zeros_like(self.bare)
        count = len(values)
        column[number * count : (number + 1) * count] = values
        return column

    # --- visibility ---------------------------------------------------------------------------

    def visibility(self) -> Visibility:
        """Return what of the hidden effects can be seen."""
        effects = self.campaign.truth.effects
        if not effects:
            return Visibility((), 0.0)
        members = self.remaining(np.transpose([self.change([e]) for e in effects]))
        gram = members.T @ members
        scale = np.sqrt(np.outer(np.diag(gram), np.diag(gram)))
        cosines = (gram / np.maximum(scale, _MIN_SQUARE)) ** 2
        np.fill_diagonal(cosines, 0.0)
        left = []
        for i in range(len(effects)):
            others = np.delete(members, i, axis=1)
            shares, *_ = np.linalg.lstsq(others, members[:, i], rcond=None)
            left.append(float(np.sum((members[:, i] - others @ shares) ** 2)))
        return Visibility(tuple(left), float(np.max(cosines)))
