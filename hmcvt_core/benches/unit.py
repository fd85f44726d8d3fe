# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""One pump or motor on a bench: the loss terms of the paper, and all that the diagnosis asks.

Pressure, speed and stroke are given, so that the model is explicit, in two channels:

.. math:: Q_l = C \, dp, \qquad T_l = f w + c \, V \epsilon \, dp

the leakage of eq. (13), the damping and the friction of eqs (14), (15). The paper takes c = 0.01,
for a transmission hardly tells it; a unit does, so that it is refitted as the other two are (the
three coefficients of Wilson 1950). Effects act through their hooks in the pump-motor pair.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..diagnosis import Diagnosis, diagnose_system, next_test
from ..diagnosis.observations import Observations
from ..diagnosis.results.outcome import NAMING
from ..diagnosis.settings import PRIOR_DOF_ASSUMED, PRIOR_DOF_STATED
from ..diagnosis.system import Axis, BaseParameters, Channel, Points
from ..errors import InputError
from ..files.units import METER_DEVIATION, TELLING, UnitSamples, sign_of
from ..model.model import EfficiencyModel
from ..physics.effects import library
from ..physics.effects.base import OIL_HOOKS, Effect, EffectParameter, ShaftState, Value
from ..physics.effects.hydraulic import CoulombStribeckFull, PressureFrictionStroke
from ..transmission.parameters import PARAMETER_NAMES, PRIOR_MEAN, PRIOR_SPREAD
from .transmission import AXES, OIL_TEMPERATURE

Array = NDArray[np.float64]

STROKE, SPEED = AXES[0], replace(AXES[1], name="speed", word="speed")
PRESSURE = Axis(
    "pressure",
    "Pa",
    "pressure",
    "pressure [Pa]",
    0,
    1e5,
    test_format="{1:.0f} bar",
    second_unit_factor=1e-5,
)
_AXES = (STROKE, SPEED, PRESSURE, OIL_TEMPERATURE)
PARAMETERS = {"leakage": "m3/(s Pa)", "damping": "N m s/rad"}
"""Parameters to be identified and their units."""
_BASE = (*PARAMETERS, "friction", "flow_gain", "torque_gain")
_GAIN, _FURTHEST = 0.0017, 3.0
# Of the meters: ISO 4409 allows 0.5 % in class A, three deviations. They are refitted within that.

DEALS = 8
"""Deals of the samples, each without its share of them, by which a set of causes is tried."""
FRICTION = 0.01
"""c_fp = c_fm of the paper [-]."""
_DECADES = (
    0.5  # of the friction of units about that, assumed: a factor of three either way
)
_SIZE = 55e-6 / (2.0 * np.pi)  # m3/rad, of which the priors of the paper's pair are
_REFERENCE, _FEWEST = "reference_displacement", 3
_STROKE_HOOKS = "true_displacement_ratio", "stroke_lag"
_STEADY = 0.75  # part of the deals that must lead to the same set


class HydrostaticUnit:
    """A pump or motor as a `diagnosis.system.System`."""

    axes: tuple[Axis, ...] = _AXES
    refusal = "cannot be run"
    advice = "check speed and pressure"

    def __init__(self, samples: UnitSamples) -> None:
        self.kind, self.displacement = samples.kind, float(samples.displacement)
        # Errors that the class of a meter allows do not scatter: a table is off smoothly. Losses
        # nobody listed are larger than that, as much as those of an efficiency are.
        whole, deviation = (
            METER_DEVIATION * samples.ideal.max(axis=1),
            samples.deviation,
        )
        self.channels = tuple(
            Channel(
                f"{name}_loss",
                unit,
                factor,
                2,
                0.0,
                False,
                (2.5 * off, 8.0 * off, 25.0 * off),
                (8.0 * off, 25.0 * off),
                off,
                least=least,
            )
            for name, unit, factor, off, least in zip(
                ("flow", "torque"),
                ("L/min", "N m"),
                (6e4, 1.0),
                whole.tolist(),
                np.median(deviation, axis=1).tolist(),
                strict=True,
            )
        )
        # Half of the leakage of a pair, within a decade; the dampings as in a transmission.
        i, size = (1 if self.kind == "motor" else 2), self.displacement / _SIZE
        self.base = BaseParameters(
            _BASE,
            np.array([PRIOR_MEAN[0] - np.log10(2.0), PRIOR_MEAN[i], 0.0, 0.0, 0.0]),
            np.array([1.0, PRIOR_SPREAD[i], _DECADES, 1.0, 1.0]),
            np.array([-16.0, 0.0, -2.0, -_FURTHEST, -_FURTHEST]),
            np.array([-8.0, 10.0, 1.2, _FURTHEST, _FURTHEST]),
            lambda base: (
                np.array([size, size, FRICTION, _GAIN, _GAIN])
                * [10.0 ** base[0], base[1], 10.0 ** base[2], *base[3:]]
            ),
        )
        # On its stop, or in proportion, the plate is the reference displacement; a charge pump on
        # the shaft is one of the constant torques, and friction at the stroke one of the base.
        varied = np.ptp(samples.displacement_ratio) > STROKE.tolerance
        full = {"displacement_error", "at full stroke", CoulombStribeckFull.form}
        twins = {
            "charge_pump",
            "gain",
            PressureFrictionStroke.form,
            *(() if varied else full),
        }
        self.library: tuple[Any, ...] = tuple(
            effect.in_unit(self.kind, size)
            for effect in library(units=True)
            if twins.isdisjoint((effect.name, effect.form))
        )

    def predict(self, base: Array, effects: Sequence[Any], points: Points) -> Array:
        """Return loss of flow [m3/s] and of torque [N m] as reckoned from readings, (2, n)."""
        leakage, damping, coefficient, *gains = self.base.values(base)
        stroke, speed, pressure = (
            points[axis.name] for axis in (STROKE, SPEED, PRESSURE)
        )
        true, still, film, viscosity = (
            stroke,
            np.zeros_like(speed),
            1.0,
            np.ones_like(speed),
        )
        for effect in effects:
            true = effect.true_displacement_ratio(true)
            if (warm := points.get(OIL_TEMPERATURE.name)) is not None:
                film = film * effect.film_viscosity_ratio(warm)
                viscosity = viscosity * effect.viscosity_ratio(warm)
        pump, motor = (speed, still) if self.kind == "pump" else (still, speed)
        state = ShaftState(
            speed,
            pump,
            speed,
            motor,
            true,
            pressure,
            viscosity,
            still,
            still,
            still,
            self.displacement,
        )

        def total(hook: str) -> Value:
            return sum((getattr(effect, hook)(state) for effect in effects), 0.0)

        true = true - total("stroke_lag")
        state = state._replace(displacement_ratio=true)
        # What the displacement stated and the stroke commanded have, and the unit has not.
        sign, ideal = (
            sign_of(self.kind),
            self.displacement * np.stack([speed, pressure]),
        )
        losses = np.stack(
            [
                leakage / viscosity * pressure + total("leakage_flow"),
                damping * film * speed
                + coefficient * true * ideal[1]
                + total(f"{self.kind}_drag"),
            ]
        )
        ways = sign * np.array([[-1.0], [1.0]])
        read = (true * ideal + ways * losses) * (1.0 + np.array(gains)[:, None])
        return np.asarray(ways * (read - stroke * ideal))

    def candidates(self, points: Points, base: Array) -> Points:
        """Return a grid over the range of the tests."""
        rows = [
            np.median(row)
            if name == OIL_TEMPERATURE.name
            else np.unique(np.linspace(row.min(), row.max(), 6))
            for name, row in points.items()
        ]
        return dict(zip(points, map(np.ravel, np.meshgrid(*rows)), strict=True))

    def lost_power(self, points: Points, expected: Array, real: Array) -> Array:
        """Return the power of the flow that is lost beyond what is expected [W], (n,)."""
        return (real - expected) * points["pressure"]

    def model_of(
        self, base: Array, effects: Sequence[Any], samples: UnitSamples
    ) -> UnitModel:
        """Return the refitted model; friction above the paper's is an effect, as in a pair."""
        friction, rest = float(self.base.values(base)[2]), np.array(base)
        rest[2] = min(rest[2], 0.0)
        above = [PressureFrictionStroke(coefficient=friction - FRICTION)] * (
            friction > FRICTION
        )
        return UnitModel(self, rest, (*effects, *above), friction)

    def remarks(self, samples: UnitSamples) -> tuple[str, ...]:
        """Say what a missing column costs."""
        return (
            ()
            if samples.oil_temperature is not None
            else ("without column oil_temperature, viscosity cannot be judged",)
        )


@dataclass(frozen=True, eq=False)
class UnitModel:
    """A unit with effects at their sizes; `base` holds its scaled parameters.

    `friction` is the whole of it, c; what the paper's does not take stands in `effects`.
    """

    system: HydrostaticUnit
    base: Array
    effects: tuple[Effect, ...]
    friction: float = FRICTION

    @property
    def parameters(self) -> dict[str, float]:
        """Base parameters by name, units as in `PARAMETERS`."""
        return dict(
            zip(PARAMETERS, self.system.base.values(self.base).tolist(), strict=False)
        )

    def losses(self, samples: UnitSamples) -> Array:
        """Loss of flow [m3/s] and torque [N m] at the points of samples, shape (2, n)."""
        return self.system.predict(self.base, self.effects, _points(samples))

    def rmse(self, samples: UnitSamples) -> list[float]:
        """Root of the mean squared error of both losses."""
        return np.sqrt(
            np.mean((samples.losses - self.losses(samples)) ** 2, axis=1)
        ).tolist()


def _points(samples: UnitSamples) -> Points:
    return {
        axis.name: row
        for axis in _AXES
        if (row := getattr(samples, axis.name)) is not None
    }


def observe_unit(system: HydrostaticUnit, samples: UnitSamples) -> Observations:
    """Set up the two channels; the stroke is an axis where it varies."""
    points = _points(samples)
    axes = tuple(
        axis
        for axis in _AXES
        if axis.name in points
        and (
            axis is not STROKE or np.ptp(samples.displacement_ratio) > STROKE.tolerance
        )
    )
    assumed = samples.noise is None
    prior_dof = np.full(
        len(system.channels), PRIOR_DOF_ASSUMED if assumed else PRIOR_DOF_STATED
    )
    return Observations(
        axes,
        points,
        system.channels,
        samples.losses,
        samples.deviation,
        prior_dof,
        samples,
        np.arange(len(samples)),
        "assumed, ISO 4409 class A" if assumed else "given",
        assumed,
    )


@dataclass(frozen=True, eq=False)
class UnitDiagnosis:
    """A diagnosis of a unit, and what it says of both channels.

    Attributes:
        found: as of any system; the gap is that of the flow loss.
        paper: the terms of the paper alone, refitted, the meters taken as exact.
        model: with the leading set of effects, whether it is named or not.
        holdout: samples held out, or None.
        same: in how many of the deals the same set leads; None where no cause is named.
    """

    found: Diagnosis
    paper: UnitModel
    model: UnitModel
    holdout: UnitSamples | None
    same: int | None

    @property
    def rmse(self) -> dict[str, dict[str, float | None]]:
        """Errors of both models by channel, m3/s and N m; None without a holdout."""
        models = {"base": self.paper, "with_effects": self.model}
        parts = {"": self.found.samples, "holdout_": self.holdout}
        return {
            channel: {
                where + name: None if samples is None else model.rmse(samples)[i]
                for where, samples in parts.items()
                for name, model in models.items()
            }
            for i, channel in enumerate(("flow", "torque"))
        }

    @property
    def errors(self) -> tuple[float, float]:
        """Standard errors: of log10 of the leakage [-], and of the damping [N m s/rad]."""
        system, names = (
            self.model.system,
            self.found.sets[0].effects if self.found.causes else (),
        )
        variance = next(
            (
                np.diag(rival.plain_model.covariance)
                for rival, _ in self.found.alive.entries
                if rival.names == names
            ),
            system.base.spread**2,
        )
        decades, damping = np.sqrt(variance[:2]).tolist()
        return decades, damping * system.displacement / _SIZE

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object of `hmcvt unit --json`."""
        data, stroke = self.found.to_dict(), self.found.samples.displacement_ratio
        for region in data["where"]:
            region.setdefault(STROKE.name, [float(stroke.min()), float(stroke.max())])
        return {
            **data,
            "rmse": self.rmse,
            "same_set_in_deals": self.same,
            "parameters": {
                name: {"value": value, "unit": PARAMETERS[name]}
                for name, value in self.model.parameters.items()
            }
            | {"friction": {"value": self.model.friction, "unit": "-"}},
        }

    def report(self) -> str:
        """Return the outcome as text for a person."""
        lines = [self.found.report()]
        if self.same is not None:
            lines.append(f"deals      the same set leads in {self.same} of {DEALS}")
        for (name, row), channel in zip(
            self.rmse.items(), self.model.system.channels, strict=True
        ):
            told = [
                f"{channel.factor * value:.3g}"
                for value in row.values()
                if value is not None
            ]
            held = f", held out {' -> '.join(told[2:])}" if told[2:] else ""
            lines.append(
                f"{name:10} rms left by the paper's terms -> with effects, "
                f"{channel.unit}: fitted {' -> '.join(told[:2])}{held}"
            )
        return "\n".join(
            (
                *lines,
                *(
                    f"{name:10} {value:.4g} {PARAMETERS[name]}"
                    for name, value in self.model.parameters.items()
                ),
                f"friction   {self.model.friction:.4g} of the pressure torque",
            )
        )


def diagnose_unit(
    samples: UnitSamples,
    holdout: UnitSamples | None = None,
    *,
    deals: bool = True,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> UnitDiagnosis:
    """Diagnose the gap between the loss terms of the paper and a unit.

    A set of causes is called found only where it leads in three quarters of the deals too. A
    reference displacement in doubt leaves other causes unnamed.

    Args:
        samples: at least five.
        holdout: of the same unit, such as a band of pressure.
        deals: whether to try a set that is named by them.
        seed: of every random number.
        progress: as of `diagnose_system`.

    Raises:
        InputError: as `diagnose_system`, or the holdout is of another unit.
    """
    if holdout is not None and (holdout.kind, holdout.displacement) != (
        samples.kind,
        samples.displacement,
    ):
        raise InputError(
            f"{holdout.source}: a {holdout.kind} of {holdout.displacement:.4g} m3/rad "
            f"is not the unit of {samples.source}"
        )
    if (
        holdout is not None
        and samples.oil_temperature is not None is holdout.oil_temperature
    ):
        raise InputError(
            f"{holdout.source}: column oil_temperature is missing; {samples.source} "
            "has it"
        )
    doubt = next(filter(None, map(_doubt, filter(None, (samples, holdout)))), None)
    dull = int(np.sum(samples.pressure < TELLING))
    notes = [
        f"{dull} samples below {TELLING:g} Pa tell no torque and were left out"
    ] * bool(dull)
    samples = samples.select(samples.pressure >= TELLING)
    if holdout is not None:
        holdout = holdout.select(holdout.pressure >= TELLING)
    system = HydrostaticUnit(samples)
    observed = observe_unit(system, samples)
    found = diagnose_system(
        system,
        observed,
        None if holdout is None else observe_unit(system, holdout),
        notes=notes,
        seed=seed,
        progress=progress,
    )
    verdict, same, model = found.verdict, None, found.base
    if found.causes:
        effects, model = found.sets[0].effects, found.causes[0].model
        if verdict in NAMING and deals:
            same = _same(system, observed, effects, seed, progress)
            verdict = "ambiguous" if same < _STEADY * DEALS else verdict
        if doubt and verdict in NAMING and effects != (_REFERENCE,):
            verdict = "unexplained"
        if not doubt and _REFERENCE in effects:
            excess = {each.name: each for each in model.effects}[_REFERENCE].values()[
                "excess"
            ]
            doubt = (
                f"the displacement stated is {100.0 * excess:+.1f} % off by the losses"
            )
    # What --noise would state is not the flow's alone.
    kept = (note for note in found.notes if "--noise" not in note)
    warnings = (doubt,) if doubt else ()
    told = replace(found, verdict=verdict, notes=(*warnings, *kept), warnings=warnings)
    return UnitDiagnosis(told, _paper(system, samples), model, holdout, same)


def _paper(system: HydrostaticUnit, samples: UnitSamples) -> UnitModel:
    """Fit leakage and damping by weighted least squares."""
    weight, friction = (
        samples.deviation**-2.0,
        np.array([0.0, FRICTION])[:, None] * samples.ideal,
    )
    driver = np.stack([samples.pressure, samples.speed])
    fitted = np.sum(weight * driver * (samples.losses - friction), axis=1) / np.sum(
        weight * driver**2, axis=1
    )
    leakage, damping = np.maximum(fitted, 0.0) / (system.displacement / _SIZE)
    return UnitModel(
        system, np.array([np.log10(leakage + 1e-16), damping, 0.0, 0.0, 0.0]), ()
    )


def _same(
    system: HydrostaticUnit,
    observed: Observations,
    effects: tuple[str, ...],
    seed: int,
    progress: Callable[[str], None] | None,
) -> int:
    """In how many deals, each without its part of the samples, a set leads."""
    order, same = np.random.default_rng(seed).permutation(len(observed)), 0
    for i, part in enumerate(np.array_split(order, DEALS), 1):
        if progress is not None:
            progress(f"deal {i} of {DEALS}")
        kept = observed.without(part)
        try:
            advice = next_test(
                system, kept, {name: row[:1] for name, row in kept.points.items()}
            )
        except InputError:  # too few are left to lead anywhere
            continue
        same += next((names for names, _ in advice.alive if names), ()) == effects
    return same


def _doubt(samples: UnitSamples) -> str | None:
    """Say that less torque is lost at high pressure than friction alone takes in the paper.

    Whatever a torque meter of class A is off: a displacement stated too large makes it so.
    """
    high = samples.select(samples.pressure > 0.5 * samples.pressure.max())
    lost = np.sort(high.torque_loss / high.ideal[1])[:_FEWEST]
    if lost.mean() >= FRICTION - _FURTHEST * _GAIN:
        return None
    return (
        f"a mechanical loss of {100.0 * lost[0]:.1f} % at high pressure is less than friction "
        f"alone takes, {100.0 * FRICTION:g} %: the displacement stated is in doubt"
    )


def put_into(model: EfficiencyModel, unit: UnitDiagnosis) -> EfficiencyModel:
    """Return a transmission with a unit in it; its standard errors are the prior of a refit.

    What a unit loses grows with its displacement. As long as one of the two is not known its
    leakage is taken to be like the other's, within the spread of units.

    Raises:
        InputError: the transmission is not of formulation `power_balance`.
    """
    if model.formulation != "power_balance":
        raise InputError(
            f"a unit needs formulation power_balance, not {model.formulation!r}"
        )
    pair, system = model.stage.pump_motor, unit.model.system
    kind, samples = system.kind, unit.found.samples
    size = {"pump": pair.pump_displacement, "motor": pair.motor_displacement}
    larger = size[kind] / system.displacement
    leakage, damping = unit.model.parameters.values()
    decades, error = unit.errors
    tested = {
        **dict(model.provenance.get("units", {})),
        kind: {
            "leakage_per_displacement": leakage / system.displacement,
            "decades": decades,
            "data": os.path.basename(samples.source),
            "data_sha256": samples.sha256,
        },
    }
    like = {**tested[kind], "decades": float(PRIOR_SPREAD[0])}
    leaks, decade = np.array(
        [
            (
                size[name] * one["leakage_per_displacement"],
                np.log(10.0) * one["decades"],
            )
            for name in size
            for one in [tested.get(name, like)]
        ]
    ).T
    own = f"{kind}_damping"
    errors = {
        **dict(zip(PARAMETER_NAMES, PRIOR_SPREAD.tolist(), strict=True)),
        **model.standard_errors,
        own: error * larger,
        "leakage": float(np.linalg.norm(leaks * decade)),
    }
    new: dict[str, Any] = {"leakage": float(leaks.sum()), own: damping * larger}
    before = {effect.name for effect in model.effects if effect.part != kind}

    def inside(effect: Effect) -> bool:
        # The stroke is the pump's, and one oil serves both.
        return not (
            effect.component == "sensor"
            or (effect.acts_at(*_STROKE_HOOKS) and kind == "motor")
            or (effect.acts_at(*OIL_HOOKS) and effect.name in before)
        )

    def scaled(effect: Effect, item: EffectParameter) -> float:
        # What acts on stroke or oil reckons by no displacement, others by the larger of the two.
        factor = (
            1.0
            if effect.acts_at(*_STROKE_HOOKS, *OIL_HOOKS)
            else larger
            if item.grows
            else size[kind] / max(size.values())
        )
        return factor * effect.values()[item.name]

    new_effects = [
        replace(
            effect,
            part=kind,
            **{item.name: scaled(effect, item) for item in effect.sizes()},
        )
        for effect in unit.model.effects
        if inside(effect)
    ]
    return replace(
        model,
        parameters=replace(model.parameters, **new),
        standard_errors=errors,
        effects=(
            *(effect for effect in model.effects if effect.part != kind),
            *new_effects,
        ),
        correlation=np.eye(len(PARAMETER_NAMES)),
        provenance={**model.provenance, "source": "hmcvt unit", "units": tested},
    )
