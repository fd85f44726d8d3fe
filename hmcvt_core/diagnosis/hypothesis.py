# SPDX-License-Identifier: Apache-2.0
"""A hypothesis: the base model with some effects, their sizes free; and its refit to the bench.

Every hypothesis is refitted together with the base parameters: three free parameters swallow most
of the signature of any effect, so a comparison at fixed base parameters would compare nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..model.model import EfficiencyModel
from ..physics.effects.base import Effect
from ..physics.effects.gears import GearEfficiency
from ..physics.effects.sensor import EngineTorqueGain
from ..transmission.parameters import HydraulicParameters
from ..transmission.points import OperatingPoints
from .observations import Observations

Array = NDArray[np.float64]

# Prior of the scaled base parameters (log10 leakage, dampings): wide, physical.
BASE_MEAN = np.array([-10.8, 0.15, 0.20])
BASE_SPREAD = np.array([0.6, 0.25, 0.40])
_BASE_LOW = np.array([-13.0, 0.0, 0.0])
_BASE_HIGH = np.array([-9.0, 3.0, 3.0])
BASE_SIZE = len(BASE_MEAN)

# Shared errors of a campaign that are no gap: systematic gain of the torque meters (paper,
# section 2.2: 0.12 %), gear efficiency within a production scatter.
NUISANCES: tuple[tuple[type[Effect], str, float], ...] = (
    (EngineTorqueGain, "gain", 0.0015),
    (GearEfficiency, "loss", 0.0005),
)
_STEPS = 25
# Standard deviations charged where a hypothesis has no answer: more than any misfit, or refits to a
# large gap would hide the worst points in stall.
REFUSED = 100.0


def to_base(parameters: HydraulicParameters) -> Array:
    """Return scaled base parameters (log10 leakage, dampings), shape (3,)."""
    values = parameters.to_array()
    values[0] = np.log10(values[0])
    return values


class Fit(NamedTuple):
    """A refitted hypothesis.

    Attributes:
        base: scaled base parameters, shape (3,).
        nuisance: shared errors in units of their prior deviation, shape (k,).
        sizes: sizes of the effects, in order, in their units.
        whitened: (measured - predicted) / deviation, shape (channels, n).
        jacobian: of the prediction / deviation by (base, nuisance, sizes in typical ones),
            shape (channels, n, p).
        noise: variance of each channel in units of the stated one, shape (channels,).
        objective: penalised squares reached.
    """

    base: Array
    nuisance: Array
    sizes: Array
    whitened: Array
    jacobian: Array
    noise: Array
    objective: float


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Base model and effects whose sizes are free.

    Attributes:
        model: stage and formulation; its own effects stay as they are.
        effects: effects with the shapes to use; their sizes are fitted.
    """

    model: EfficiencyModel
    effects: tuple[Effect, ...] = ()

    @property
    def label(self) -> str:
        """Names and forms, for messages."""
        return " + ".join(f"{effect.name} {effect.form}".strip() for effect in self.effects)

    @property
    def size_limits(self) -> Array:
        """Lower and upper bound of each size, shape (k, 2)."""
        limits = [(item.low, item.high) for effect in self.effects for item in effect.sizes()]
        return np.array(limits).reshape(-1, 2)

    @property
    def size_scales(self) -> Array:
        """Typical size of each, shape (k,)."""
        return np.array([item.typical for effect in self.effects for item in effect.sizes()])

    def with_sizes(self, sizes: Array) -> tuple[Effect, ...]:
        """Return the effects at given sizes."""
        values = iter(sizes.tolist())
        return tuple(effect.with_values({item.name: next(values) for item in effect.sizes()})
                     for effect in self.effects)

    def model_at(self, base: Array, sizes: Array) -> EfficiencyModel:
        """Return the model at scaled base parameters and sizes."""
        parameters = HydraulicParameters(float(10.0 ** base[0]), float(base[1]), float(base[2]))
        return replace(self.model, parameters=parameters,
                       effects=(*self.model.effects, *self.with_sizes(sizes)))


def predict(model: EfficiencyModel, points: OperatingPoints, channels: int) -> Array:
    """Efficiency and (with two channels) output speed; shape (channels, n)."""
    return np.stack(model.answer_at(points)[:channels])


def nuisance_columns(model: EfficiencyModel, observed: Observations) -> Array:
    """Change of prediction / deviation by one prior deviation of each nuisance, (c, n, k)."""
    count = len(observed.channels)
    here = predict(model, observed.points, count)
    columns = []
    for kind, name, deviation in NUISANCES:
        moved = replace(model, effects=(*model.effects, kind(**{name: deviation})))
        columns.append((predict(moved, observed.points, count) - here) / observed.scale)
    return np.nan_to_num(np.stack(columns, axis=-1))


def refit(
    hypothesis: Hypothesis,
    observed: Observations,
    start: Array,
    sizes: Array | None = None,
    nuisance: Array | None = None,
    noise: Array | None = None,
    steps: int = _STEPS,
) -> Fit:
    """Fit base parameters, nuisances and sizes by damped Gauss-Newton within bounds.

    Args:
        hypothesis: what is assumed.
        observed: the bench.
        start: scaled base parameters to start from, shape (3,).
        sizes: sizes to start from; None for a tenth of the typical ones.
        nuisance: columns of `nuisance_columns`; None computes them at the start.
        noise: variances of the channels to keep; None estimates them along the way.
        steps: iterations at most.
    """
    return _Refit(hypothesis, observed, start, sizes, nuisance, noise).run(steps)


class _Refit:
    """One refit; theta = (base, nuisance, sizes / typical)."""

    def __init__(
        self,
        hypothesis: Hypothesis,
        observed: Observations,
        start: Array,
        sizes: Array | None,
        nuisance: Array | None,
        noise: Array | None,
    ) -> None:
        self.hypothesis, self.observed = hypothesis, observed
        self.scales = hypothesis.size_scales
        if nuisance is None:
            nuisance = nuisance_columns(hypothesis.model_at(start, 0.0 * self.scales), observed)
        self.columns = nuisance
        k = nuisance.shape[-1]
        limits = hypothesis.size_limits / self.scales[:, None]
        self.low = np.concatenate([_BASE_LOW, np.full(k, -6.0), limits[:, 0]])
        self.high = np.concatenate([_BASE_HIGH, np.full(k, 6.0), limits[:, 1]])
        first = 0.1 * np.ones(len(self.scales)) if sizes is None else sizes / self.scales
        self.theta = np.clip(np.concatenate([start, np.zeros(k), first]), self.low, self.high)
        free = np.zeros(len(self.scales))
        self.mean = np.concatenate([BASE_MEAN, np.zeros(k), free])
        # Sizes are held by their bounds alone; their prior enters when evidence is weighed.
        self.weight = np.concatenate([BASE_SPREAD**-2, np.ones(k), free])
        self.fixed_noise = noise
        self.noise = np.ones(len(observed.channels)) if noise is None else noise

    def split(self, theta: Array) -> tuple[Array, Array, Array]:
        """Return base, nuisance, sizes."""
        k = self.columns.shape[-1]
        return (theta[:BASE_SIZE], theta[BASE_SIZE:BASE_SIZE + k],
                theta[BASE_SIZE + k:] * self.scales)

    def residuals(self, theta: Array) -> Array:
        """Whitened residuals, shape (channels, n)."""
        base, nuisance, sizes = self.split(theta)
        model = self.hypothesis.model_at(base, sizes)
        predicted = predict(model, self.observed.points, len(self.observed.channels))
        whitened = self.observed.whiten(predicted) - self.columns @ nuisance
        return np.where(np.isnan(whitened), REFUSED, whitened)

    def objective(self, theta: Array, residuals: Array) -> float:
        """Penalised squares at the current noise."""
        prior = np.sum(self.weight * (theta - self.mean) ** 2)
        return float(np.sum(np.sum(residuals**2, axis=1) / self.noise) + prior)

    def jacobian(self, theta: Array, residuals: Array) -> Array:
        """Of the prediction / deviation, shape (channels, n, p); sizes in typical units."""
        columns = np.empty((*residuals.shape, len(theta)))
        k = self.columns.shape[-1]
        columns[..., BASE_SIZE:BASE_SIZE + k] = self.columns
        for i in (*range(BASE_SIZE), *range(BASE_SIZE + k, len(theta))):
            step = 1e-5 if i < BASE_SIZE else 1e-3
            if theta[i] + step > self.high[i]:
                step = -step
            moved = theta.copy()
            moved[i] += step
            columns[..., i] = (residuals - self.residuals(moved)) / step
        return columns

    def renew_noise(self, residuals: Array) -> None:
        """Estimate the variance of each channel from its residuals and what was stated."""
        if self.fixed_noise is None:
            trust = self.observed.trusts
            n = residuals.shape[1]
            used = min(len(self.theta), n - 1) / len(self.noise)
            squares = np.sum(residuals**2, axis=1)
            self.noise = (trust + squares) / (trust + np.maximum(n - used, 1.0))

    def run(self, steps: int) -> Fit:
        """Iterate to convergence."""
        theta, damping = self.theta, 1e-3
        residuals = self.residuals(theta)
        self.renew_noise(residuals)
        for _ in range(steps):
            jacobian = self.jacobian(theta, residuals)
            value = self.objective(theta, residuals)
            gain = 0.0
            for _ in range(6):
                trial = self.step(theta, residuals, jacobian, damping)
                tried = self.residuals(trial)
                gain = value - self.objective(trial, tried)
                if gain >= 0.0:
                    theta, residuals, damping = trial, tried, max(damping / 10.0, 1e-9)
                    break
                damping *= 10.0
            before = self.noise
            self.renew_noise(residuals)
            moved = np.max(np.abs(np.log(self.noise / before)))
            if gain < 1e-4 and moved < 1e-3:
                break
        jacobian = self.jacobian(theta, residuals)
        base, nuisance, sizes = self.split(theta)
        return Fit(base, nuisance, sizes, residuals, jacobian, self.noise,
                   self.objective(theta, residuals))

    def step(self, theta: Array, residuals: Array, jacobian: Array, damping: float) -> Array:
        """Solve the damped normal equations with parameters at their bounds held there."""
        scaled = jacobian / np.sqrt(self.noise)[:, None, None]
        flat = scaled.reshape(-1, len(theta))
        target = (residuals / np.sqrt(self.noise)[:, None]).ravel()
        normal = flat.T @ flat + np.diag(self.weight)
        slope = flat.T @ target - self.weight * (theta - self.mean)
        free = ~(((theta <= self.low) & (slope < 0.0)) | ((theta >= self.high) & (slope > 0.0)))
        diagonal = np.diag(normal)[free]
        matrix = normal[np.ix_(free, free)] + np.diag(damping * diagonal + 1e-9)
        change = np.zeros(len(theta))
        change[free] = np.linalg.solve(matrix, slope[free])
        return np.clip(theta + change, self.low, self.high)


def forms_of(kind: type[Effect]) -> Sequence[Effect]:
    """Return one instance per combination of the shapes' grids."""
    instances = [kind()]
    for parameter in kind.parameters():
        if not parameter.is_size:
            instances = [instance.with_values({parameter.name: value})
                         for instance in instances for value in parameter.grid]
    return instances


def linearise(hypothesis: Hypothesis, observed: Observations, fit: Fit) -> tuple[Array, Array]:
    """Whitened residuals and Jacobian of a fit at other operating points.

    Returns:
        Shapes (channels, n) and (channels, n, p); sizes in typical units.
    """
    model = hypothesis.model_at(fit.base, fit.sizes)
    columns = nuisance_columns(model, observed)
    there = _Refit(hypothesis, observed, fit.base, fit.sizes, columns, fit.noise)
    k = columns.shape[-1]
    there.theta[BASE_SIZE:BASE_SIZE + k] = fit.nuisance
    residuals = there.residuals(there.theta)
    return residuals, there.jacobian(there.theta, residuals)
