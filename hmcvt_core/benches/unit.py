# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""One pump or motor on a bench: the loss terms of the paper, and all that the diagnosis asks.

Pressure, speed and stroke are given, so that the model is explicit, in two channels:

.. math:: Q_l = C \, dp, \qquad T_l = f w + c \, V \epsilon \, dp

the leakage of eq. (13), the damping and the friction of eqs (14), (15) with c = 0.01. Effects act
through the hooks that they have in the pump-motor pair.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..diagnosis import Diagnosis, diagnose_system, next_test
from ..diagnosis.observations import TRUST_ASSUMED, TRUST_STATED, Observations, Reading
from ..diagnosis.result import NAMING
from ..diagnosis.system import Axis, BaseParameters, Channel, Points
from ..errors import InputError
from ..files.units import METER_DEVIATION, TELLING, UnitSamples
from ..model.model import EfficiencyModel
from ..physics.effects import library
from ..physics.effects.base import Effect, EffectParameter, ShaftState, Value
from ..transmission.parameters import (
    PARAMETER_NAMES,
    PRIOR_MEAN,
    PRIOR_SPREAD,
    HydraulicParameters,
)
from ..transmission.ranges import RPM
from .transmission import OIL_TEMPERATURE

Array = NDArray[np.float64]

STROKE = Axis("displacement_ratio", "-", "displacement ratio", "stroke", 2, 0.001, graded=False,
              told="stroke {0:.2f}")
SPEED = Axis("speed", "rad/s", "speed", "speed [rad/s]", 1, RPM,
             told="{0:.1f} rad/s ({1:.0f} r/min)", second=1.0 / RPM)
PRESSURE = Axis("pressure", "Pa", "pressure", "pressure [Pa]", 0, 1e5, told="{1:.0f} bar",
                second=1e-5)
PARAMETERS = {"leakage": "m3/(s Pa)", "damping": "N m s/rad"}
"""Base parameters and their units."""

FRICTION = 0.01  # c_fp = c_fm of the paper
_SIZE = 55e-6 / (2.0 * np.pi)  # m3/rad, of which the priors of the paper's pair are
_GRID = (5, 6, 6)
_REFERENCE, _FEWEST = "reference_displacement", 3
_DEALS, _STEADY = 8, 6  # deals of the samples, and how many must lead to the same set
_OF_ANY_SIZE = ("-", "1/GPa")  # sizes in these are the same in small units and in large ones


class HydrostaticUnit:
    """A pump or motor as a `diagnosis.system.System`.

    Attributes:
        kind, displacement: as of `UnitSamples`.
    """

    refusal = "cannot be run"
    advice = "check speed and pressure"

    def __init__(self, samples: UnitSamples) -> None:
        self.kind, self.displacement = samples.kind, samples.displacement
        self._sign = 1.0 if self.kind == "pump" else -1.0
        self.axes: tuple[Axis, ...] = (STROKE, SPEED, PRESSURE, OIL_TEMPERATURE)
        # The errors of meters by class hardly scatter: a table is off smoothly by so much of the
        # ideal flow and torque. Losses nobody listed are larger, as those of an efficiency are.
        off = [METER_DEVIATION * float(each.max())
               for each in (samples.ideal_flow, samples.ideal_torque)]
        deviations = samples.flow_std, samples.torque_std
        self.channels = tuple(
            Channel(name, unit, factor, 2, 0.0, False,
                    (2.5 * off[i], 8.0 * off[i], 25.0 * off[i]), (8.0 * off[i], 25.0 * off[i]),
                    off[i], least=float(np.median(deviations[i])))
            for i, (name, unit, factor) in enumerate((("flow_loss", "L/min", 6e4),
                                                      ("torque_loss", "N m", 1.0))))
        damping = 1 if self.kind == "motor" else 2
        # Half of the pair's leakage, to within a decade; the dampings as in the transmission.
        self.base = BaseParameters(
            tuple(PARAMETERS), np.array([PRIOR_MEAN[0] - np.log10(2.0), PRIOR_MEAN[damping]]),
            np.array([1.0, PRIOR_SPREAD[damping]]), np.array([-16.0, 0.0]),
            np.array([-8.0, 10.0]), self._values)
        size = self.displacement / _SIZE
        varied = np.ptp(samples.displacement_ratio) > STROKE.held
        # On its stop, or in proportion, the plate is the reference displacement; and a charge pump
        # on the shaft is one of the constant torques.
        self.library: tuple[Any, ...] = tuple(
            Sized(kind(), size, self.kind) for kind in library(units=True)
            if kind.name != "charge_pump" and kind.form != "gain"
            and (varied or kind.name != "displacement_error"))

    def _values(self, base: Array) -> Array:
        size = self.displacement / _SIZE
        return np.array([10.0 ** base[0], base[1]]) * size

    def predict(self, base: Array, effects: Sequence[Any], points: Points) -> Array:
        """Return loss of flow [m3/s] and of torque [N m] as reckoned from readings, (2, n)."""
        leakage, damping = self._values(base)
        stroke, speed, pressure = (points[axis.name] for axis in (STROKE, SPEED, PRESSURE))
        viscosity: Value = 1.0
        if OIL_TEMPERATURE.name in points:
            for effect in effects:
                viscosity = viscosity * effect.viscosity_ratio(points[OIL_TEMPERATURE.name])
        true = stroke
        for effect in effects:
            true = effect.true_displacement_ratio(true)
        state = self._state(true, speed, pressure, viscosity)
        true = true - _sum(effects, "stroke_lag", state)
        state = state._replace(displacement_ratio=true)
        # What the reference displacement has that the unit has not, and the plate.
        missing = self._sign * self.displacement * (stroke - true)
        flow = (leakage / viscosity * pressure + _sum(effects, "leakage_flow", state)
                + missing * speed)
        torque = (damping * viscosity * speed + FRICTION * self.displacement * true * pressure
                  + _sum(effects, f"{self.kind}_drag", state) - missing * pressure)
        return np.stack([flow, torque])

    def _state(self, stroke: Array, speed: Array, pressure: Array, viscosity: Value) -> ShaftState:
        still = np.zeros_like(speed)
        pump, motor = (speed, still) if self.kind == "pump" else (still, speed)
        return ShaftState(speed, pump, speed, motor, stroke, pressure, viscosity, still, still,
                          self.displacement * stroke * pressure * speed, self.displacement)

    def candidates(self, points: Points, base: Array) -> Points:
        """Return a grid over the range of the tests."""
        rows = [np.unique(np.linspace(points[axis.name].min(), points[axis.name].max(), count))
                for axis, count in zip((STROKE, SPEED, PRESSURE), _GRID, strict=True)]
        grid = dict(zip((STROKE.name, SPEED.name, PRESSURE.name),
                        (each.ravel() for each in np.meshgrid(*rows)), strict=True))
        return {name: grid.get(name, np.full(grid["speed"].size, np.median(points[name])))
                for name in points}

    def lost_power(self, points: Points, expected: Array, real: Array) -> Array:
        """Return the power of the flow that is lost beyond what is expected [W], (n,)."""
        return (real - expected) * points["pressure"]

    def model_of(
        self, base: Array, effects: Sequence[Any], samples: UnitSamples
    ) -> UnitModel:
        """Return the refitted model."""
        return UnitModel(self, base, tuple(effects), samples)

    def remarks(self, samples: UnitSamples) -> tuple[str, ...]:
        """Say what a missing column costs."""
        return () if samples.oil_temperature is not None else (
            "without column oil_temperature, viscosity cannot be judged",)


@dataclass(frozen=True)
class Sized:
    """An effect at its size in the paper's unit, as it is in one of another displacement.

    Attributes:
        effect: what acts.
        factor: displacement / that of the paper's unit: sizes that grow with it are so much larger.
        kind: of the unit in which it acts.
    """

    effect: Effect
    factor: float
    kind: str

    def __getattr__(self, name: str) -> Any:
        return getattr(self.effect, name)

    @property
    def component(self) -> str:
        """The unit on the bench, where the effect belongs to one."""
        own = self.effect.component
        return self.kind if own in ("pump", "motor") else own

    def parameters(self) -> list[EffectParameter]:
        """As of the effect, with the sizes of this displacement."""
        return [item if item.unit in _OF_ANY_SIZE or not item.is_size else replace(
            item, **{end: self.factor * getattr(item, end) for end in ("typical", "low", "high")})
            for item in self.effect.parameters()]

    def sizes(self) -> list[EffectParameter]:
        """Those of the parameters that switch it off."""
        return [item for item in self.parameters() if item.is_size]

    def with_values(self, values: dict[str, float]) -> Sized:
        """Return a copy with other parameter values."""
        return replace(self, effect=self.effect.with_values(values))

    def inside(self, larger: float, part: float) -> Effect:
        """The effect in that unit of a transmission.

        Args:
            larger: displacement there / here.
            part: of the larger of pump and motor, by which effects reckon.
        """
        values = self.effect.values()
        for item in self.effect.sizes():
            values[item.name] *= part if item.unit in _OF_ANY_SIZE else larger
        return replace(self.effect, part=self.kind, **values)


def _sum(effects: Sequence[Any], hook: str, state: ShaftState) -> Value:
    return sum((getattr(effect, hook)(state) for effect in effects), 0.0)


@dataclass(frozen=True, eq=False)
class UnitModel:
    """A unit with effects, fitted to samples.

    Attributes:
        system, base: whose parameters these are, scaled.
        effects: at their sizes.
        samples: that they were fitted to.
    """

    system: HydrostaticUnit
    base: Array
    effects: tuple[Sized, ...]
    samples: UnitSamples

    @property
    def parameters(self) -> dict[str, float]:
        """Base parameters by name, units as in `PARAMETERS`."""
        return dict(zip(PARAMETERS, self.system.base.values(self.base).tolist(), strict=True))

    def losses(self, samples: UnitSamples) -> Array:
        """Loss of flow [m3/s] and torque [N m] at the points of samples, shape (2, n)."""
        return self.system.predict(self.base, self.effects, _points(samples))

    def covariance(self) -> Array:
        """Of the base parameters as scaled, linearised, sizes of the effects free, (2, 2)."""
        sizes = [(i, item) for i, effect in enumerate(self.effects) for item in effect.sizes()]

        def scaled(theta: Array) -> Array:
            effects = list(self.effects)
            for (i, item), change in zip(sizes, theta[2:].tolist(), strict=True):
                effects[i] = effects[i].with_values(
                    {item.name: effects[i].values()[item.name] + change * item.typical})
            return self.system.predict(self.base + theta[:2], effects, _points(self.samples))

        left = _measured(self.samples) - self.losses(self.samples)
        free = max(left.shape[1] - 1.5, 1.0)
        deviation = np.sqrt(np.sum(left**2, axis=1, keepdims=True) / free)
        steps = 1e-4 * np.eye(2 + len(sizes))
        slopes = np.array([((scaled(step) - scaled(-step)) / 2e-4 / deviation).ravel()
                           for step in steps])
        prior = np.append(self.system.base.spread ** -2.0, np.full(len(sizes), 0.04))
        return np.linalg.inv(slopes @ slopes.T + np.diag(prior))[:2, :2]


def _points(samples: UnitSamples) -> Points:
    names = [axis.name for axis in (STROKE, SPEED, PRESSURE, OIL_TEMPERATURE)]
    return {name: row for name in names if (row := getattr(samples, name)) is not None}


def _measured(samples: UnitSamples) -> Array:
    return np.stack([samples.flow_loss, samples.torque_loss])


def observe_unit(system: HydrostaticUnit, samples: UnitSamples) -> Observations:
    """Set up the two channels; the stroke is an axis where it varies."""
    points = _points(samples)
    axes = tuple(axis for axis in system.axes if axis.name in points
                 and (axis is not STROKE or np.ptp(samples.displacement_ratio) > STROKE.held))
    trust = TRUST_ASSUMED if samples.assumed else TRUST_STATED
    readings = tuple(
        Reading(channel, values, deviation, trust) for channel, values, deviation in zip(
            system.channels, _measured(samples), (samples.flow_std, samples.torque_std),
            strict=True))
    return Observations(axes, points, readings, samples, np.arange(len(samples)),
                        samples.noise_source, samples.assumed, channels=system.channels)


@dataclass(frozen=True, eq=False)
class UnitDiagnosis:
    """A diagnosis of a unit, and what it says of both channels.

    Attributes:
        found: where, which, how far, as of any system; the gap is that of the flow loss.
        paper: the model with the terms of the paper alone, refitted.
        model: with the leading set of effects, whether it is named or not.
        holdout: samples held out, or None.
        same: in how many of the deals of the samples the same set leads; None without a gap.
    """

    found: Diagnosis
    paper: UnitModel
    model: UnitModel
    holdout: UnitSamples | None
    same: int | None

    @property
    def rmse(self) -> dict[str, dict[str, float | None]]:
        """Errors of both models by channel, m3/s and N m; None without a holdout."""
        rows = [_rms(model, samples) for samples in (self.found.samples, self.holdout)
                for model in (self.paper, self.model)]
        names = ("base", "with_effects", "holdout_base", "holdout_with_effects")
        return {channel: {name: row[i] for name, row in zip(names, rows, strict=True)}
                for i, channel in enumerate(("flow", "torque"))}

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object of `hmcvt unit --json`."""
        data, stroke = self.found.to_dict(), self.found.samples.displacement_ratio
        for region in data["where"]:
            region.setdefault(STROKE.name, [float(stroke.min()), float(stroke.max())])
        return {**data, "rmse": self.rmse, "deals": None if self.same is None else {
            "same": self.same, "of": _DEALS}, "parameters": {
                name: {"value": value, "unit": PARAMETERS[name]}
                for name, value in self.model.parameters.items()}}

    def report(self) -> str:
        """Return the outcome as text for a person."""
        lines = [self.found.report()]
        if self.same is not None:
            lines.append(f"deals      the same set leads in {self.same} of {_DEALS} deals of the "
                         "samples")
        for channel, factor, unit in (("flow", 6e4, "L/min"), ("torque", 1.0, "N m")):
            told = [f"{label} {factor * row[0]:.3g} -> {factor * row[1]:.3g} {unit}"
                    for label, row in (("fitted", (one["base"], one["with_effects"])), (
                        "held out", (one["holdout_base"], one["holdout_with_effects"])))
                    if row[0] is not None and row[1] is not None] if (
                        one := self.rmse[channel]) else []
            lines.append(f"{channel:10} rms of the paper's terms -> with effects: "
                         f"{', '.join(told)}")
        lines += [f"{name:10} {value:.4g} {PARAMETERS[name]}"
                  for name, value in self.model.parameters.items()]
        return "\n".join(lines)


def _rms(model: UnitModel, samples: UnitSamples | None) -> list[float] | list[None]:
    if samples is None:
        return [None, None]
    left = _measured(samples) - model.losses(samples)
    found: list[float] = np.sqrt(np.mean(left**2, axis=1)).tolist()
    return found


def diagnose_unit(
    samples: UnitSamples,
    holdout: UnitSamples | None = None,
    *,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> UnitDiagnosis:
    """Diagnose the gap between the loss terms of the paper and a unit.

    A set of causes is called found only where it leads in six of eight deals of the samples too,
    each without an eighth of them. A reference displacement in doubt leaves every cause unnamed.

    Args:
        samples: at least five.
        holdout: of the same unit, such as a band of pressure.
        seed: of every random number.
        progress: as of `diagnose_system`.

    Raises:
        InputError: as `diagnose_system`, or the holdout is of another unit.
    """
    if holdout is not None and (holdout.kind, holdout.displacement) != (
            samples.kind, samples.displacement):
        raise InputError(f"{holdout.source}: a {holdout.kind} of {holdout.displacement:.4g} m3/rad "
                         f"is not the unit of {samples.source}")
    doubt = _doubt(samples) or (None if holdout is None else _doubt(holdout))
    notes = []
    told = samples.pressure >= TELLING
    if not told.all():
        notes.append(f"{int(np.sum(~told))} samples below {TELLING:g} Pa tell no torque and were "
                     "left out")
        samples = samples.select(told)
    if holdout is not None:
        holdout = holdout.select(holdout.pressure >= TELLING)
    system = HydrostaticUnit(samples)
    observed = observe_unit(system, samples)
    held = None if holdout is None else observe_unit(system, holdout)
    found = diagnose_system(system, observed, held, notes=notes, seed=seed, progress=progress)
    verdict, same, model = found.verdict, None, found.base
    if found.causes:
        effects, model = found.sets[0].effects, found.causes[0].model
        if verdict in NAMING:
            same = _same(system, observed, effects, seed, progress)
            verdict = "ambiguous" if same < _STEADY else verdict
        if _REFERENCE in effects:
            excess, = (effect.values()["excess"] for effect in model.effects
                       if effect.name == _REFERENCE)
            doubt = (f"the losses are those of another displacement: the one stated is "
                     f"{100.0 * excess:+.1f} % off")
        elif doubt and verdict in NAMING:
            verdict = "unexplained"
    # What states a noise would do so for the flow alone.
    kept = tuple(note for note in found.notes if "--noise" not in note)
    warnings = (doubt,) if doubt else ()
    return UnitDiagnosis(replace(found, verdict=verdict, notes=(*warnings, *kept),
                                 warnings=warnings), found.base, model, holdout, same)


def _same(
    system: HydrostaticUnit, observed: Observations, effects: tuple[str, ...], seed: int,
    progress: Callable[[str], None] | None,
) -> int:
    """In how many deals, each without its part of the samples, a set leads."""
    order, same = np.random.default_rng(seed).permutation(len(observed)), 0
    for i, part in enumerate(np.array_split(order, _DEALS), 1):
        if progress is not None:
            progress(f"deal {i} of {_DEALS}")
        kept = observed.select(np.setdiff1d(order, part))
        few = {name: row[:_DEALS] for name, row in kept.points.items()}
        alive = next_test(system, kept, few).alive
        same += next((names for names, _ in alive if names), ()) == effects
    return same


def _doubt(samples: UnitSamples) -> str | None:
    """Say that less torque is lost at high pressure than friction alone takes, as the paper has it.

    A reference displacement that is too large makes it so.
    """
    high = samples.select(samples.pressure > 0.5 * samples.pressure.max())
    lost = np.sort(high.torque_loss / high.ideal_torque)[:_FEWEST]
    if lost.mean() >= FRICTION:
        return None
    return (f"a torque loss of {100.0 * lost[0]:.1f} % at high pressure is less than friction "
            f"alone takes ({100.0 * FRICTION:g} %): the displacement stated is in doubt")


def put_into(model: EfficiencyModel, unit: UnitModel) -> EfficiencyModel:
    """Return a transmission with a unit in it; its standard errors are the prior of a refit.

    What a unit loses grows with its displacement. As long as one of the two is not known its
    leakage is taken to be like the other's, within the spread of units.

    Raises:
        InputError: the transmission is not of formulation `power_balance`.
    """
    if model.formulation != "power_balance":
        raise InputError(f"a unit needs formulation power_balance, not {model.formulation!r}")
    pair, kind, whole = model.stage.pump_motor, unit.system.kind, unit.system.displacement
    size = {"pump": pair.pump_displacement, "motor": pair.motor_displacement}
    leakage, damping = unit.parameters.values()
    decades, scaled_error = np.sqrt(np.diag(unit.covariance())).tolist()
    tested = {**dict(model.provenance.get("units", {})), kind: {
        "leakage_per_displacement": leakage / whole, "decades": decades,
        "data": unit.samples.source.rsplit("/", 1)[-1], "data_sha256": unit.samples.sha256}}
    # Of pump and motor; what is not known is like the other, within the spread of units.
    each = [tested.get(name, {**tested[kind], "decades": float(PRIOR_SPREAD[0])}) for name in size]
    leaks = np.array([one["leakage_per_displacement"] for one in each]) * list(size.values())
    spread = np.log(10.0) * leaks * [one["decades"] for one in each]
    unknown = dict(zip(PARAMETER_NAMES, PRIOR_SPREAD.tolist(), strict=True))
    errors = {**unknown, **model.standard_errors, "leakage": float(np.hypot(*spread)),
              f"{kind}_damping": scaled_error * size[kind] / _SIZE}
    values = {**{name: getattr(model.parameters, name) for name in PARAMETER_NAMES},
              "leakage": float(leaks.sum()), f"{kind}_damping": damping * size[kind] / whole}
    effects = [effect for effect in model.effects if effect.part != kind]
    for effect in unit.effects:
        if effect.component != "sensor":
            effects.append(effect.inside(size[kind] / whole, size[kind] / max(size.values())))
    return replace(
        model, parameters=HydraulicParameters(**values), effects=tuple(effects),
        standard_errors=errors, correlation=np.eye(len(PARAMETER_NAMES)),
        provenance={**model.provenance, "source": "hmcvt unit", "units": tested})
