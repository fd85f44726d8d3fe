# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Statement: scatter above its statement that no recorded axis explains.

Either the noise is stated too small, or a quantity varied that was not recorded. In the second
case a quantity g of time changes the readings by its signature s, which the system knows:

.. math:: r = P(s \circ g + \epsilon), \qquad g \sim N(0, a^2 K), \quad \epsilon \sim N(0, I)

in stated deviations, with the projector P that the refit of the base model leaves. K is the
identity (anew at each test), one for each pair of tests of a session, or exp(-|t - t'| / T) with T
of minutes or hours (Ornstein-Uhlenbeck). The hypotheses compete by their marginal likelihoods, the
amplitude a averaged over a grid. Two rivals vary with nothing that time orders: noise stated too
small, which is one factor of one channel, and a base model that is smoothly off.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..fitting.refit import Fit, refit
from ..observations import SESSION, Observations, scaled_to_extent
from ..selection.discrepancy import Discrepancy
from ..settings import (
    LIKELY,
    PRESENT_PROBABILITY,
    RELEVANT_PROBABILITY,
    SCATTER_AMPLITUDES,
    SCATTER_SAMPLES,
    SCATTER_TIMES,
)
from ..system import Array, Unrecorded
from ..wording import listed, probability
from .agreement import Agreement, RowsAtStatement, rows_at_statement

NOISE = "noise"
BASE_MODEL = "base model"
UNLISTED = "unlisted loss"
_RIVALS = (NOISE, BASE_MODEL, UNLISTED)
"""Rivals of a quantity that was not recorded."""
TESTS = "tests"
MINUTES = "minutes"
HOURS = "hours"
SESSIONS = "sessions"
"""Time scales."""
HOUR = 3600.0
FIELD_LENGTHS = (0.2, 0.5)
"""Lengths of a loss along all axes, as parts of their ranges; chosen, narrow and wide."""
RESONANCE_LENGTHS = (0.08, 1.0)
"""Lengths of a loss in a narrow band of one axis: along that axis, and along the others; chosen."""
_OVER = {
    TESTS: "from test to test",
    MINUTES: "over minutes",
    HOURS: "over hours",
    SESSIONS: "from session to session",
}


@dataclass(frozen=True)
class ExcessScatter:
    """Scatter above the stated noise: the statement is too small, or something varied unrecorded.

    Attributes:
        ratio: scatter / stated noise of `channel`.
        channel: whose noise was stated.
        time_scale: `tests` (each test anew), `minutes`, `hours` or `sessions`; None where the
            samples have neither stamps nor sessions, or none is more likely than not.
        quantities: what may have varied, with the probability of each, most probable first; the
            names `noise` and `base model` stand for a noise stated too small and a base model that
            is smoothly off.
        sensor: what to record to find out, in words; empty where nothing is known.
        sentence: all of it in one sentence.
    """

    ratio: float
    channel: str
    time_scale: str | None
    quantities: tuple[tuple[str, float], ...]
    sensor: str
    sentence: str

    @property
    def is_probable(self) -> bool:
        """Whether a loss along the axes is hardly possible: plans confound time and axes."""
        of_rivals = [p for name, p in self.quantities if name in (BASE_MODEL, UNLISTED)]
        return sum(of_rivals) <= 1.0 - PRESENT_PROBABILITY


class _Kernel(NamedTuple):
    """How a quantity varies over the tests.

    Attributes:
        time_scale: as of `ExcessScatter`.
        root: K = root root', shape (n, m).
    """

    time_scale: str
    root: Array


class _Rival(NamedTuple):
    """One hypothesis with its log evidence against noise as stated."""

    quantity: str
    time_scale: str | None
    log_evidence: float


def excess_scatter(
    fit: Fit, agreement: Agreement, unlisted: Discrepancy | None = None
) -> ExcessScatter | None:
    """Return what scatters above its statement, or None where readings and noise agree.

    Args:
        fit: a refit to the readings, with or without effects.
        agreement: of the same fit.
        unlisted: a loss along the axes that explains the readings too, as a further rival.
    """
    if agreement.holds:
        return None
    fit = _thinned(fit)
    observed = fit.observed
    rows = rows_at_statement(fit)
    evidence = _Evidence(rows)
    unrecorded = _unrecorded_of(rows.fit)
    kernels = _kernels(observed)
    rivals = [
        _Rival(NOISE, TESTS, evidence.of_channel()),
        _Rival(BASE_MODEL, None, evidence.of_base_model()),
    ]
    for lengths in _lengths_of_fields(len(observed.steered)):
        rivals.append(_Rival(UNLISTED, None, evidence.of_field(lengths)))
    if unlisted is not None:
        changes = unlisted.columns(observed)
        rivals.append(_Rival(UNLISTED, None, evidence.of_changes(changes)))
    for quantity in unrecorded:
        signature = quantity.change / observed.deviation
        for kernel in kernels:
            log_evidence = evidence.of_quantity(signature, kernel.root)
            rivals.append(_Rival(quantity.name, kernel.time_scale, log_evidence))
    return _summary(rivals, unrecorded, kernels, agreement, observed)


def _thinned(fit: Fit) -> Fit:
    """Return a fit to some of the readings, in the order of the samples, if there are many."""
    observed = fit.observed
    if len(observed) <= SCATTER_SAMPLES:
        return fit
    # Neighbours in time are kept together: they determine the time scale.
    times = _stamps_of(observed)
    order = np.arange(len(observed)) if times is None else np.argsort(times)
    start = (len(observed) - SCATTER_SAMPLES) // 2
    kept = np.sort(order[start : start + SCATTER_SAMPLES])
    return refit(fit.hypothesis, observed.select(kept), fit.theta)


def _stamps_of(observed: Observations) -> Array | None:
    """Return the time of each sample [s], shape (n,); None where not all are known."""
    stamps = getattr(observed.samples, "stamp", None)
    if stamps is None:
        return None
    times = np.asarray(stamps, dtype=float)
    return times if np.isfinite(times).all() else None


def _unrecorded_of(fit: Fit) -> list[Unrecorded]:
    """Return the quantities that the system knows and the bench does not record."""
    system: Any = fit.hypothesis.system
    known: Callable[..., Sequence[Unrecorded]] | None
    known = getattr(system, "unrecorded", None)
    if known is None:
        return []
    rows = fit.hypothesis.rows_of(fit.observed.channels)
    quantities = []
    for item in known(fit.base, fit.observed.points):
        column = item.name.replace(" ", "_")
        if getattr(fit.observed.samples, column, None) is not None:
            continue
        change = np.nan_to_num(item.change[rows])
        if change.any():
            quantities.append(Unrecorded(item.name, item.sensor, change))
    return quantities


def _kernels(observed: Observations) -> list[_Kernel]:
    """Return how a quantity may vary over the tests, as far as their times are known."""
    n = len(observed)
    kernels = [_Kernel(TESTS, np.eye(n))]
    sessions = observed.points.get(SESSION, np.zeros(n))
    numbers = np.unique(sessions[sessions >= 0.0])
    if len(numbers) > 1:
        of_session = sessions[:, None] == numbers
        kernels.append(_Kernel(SESSIONS, of_session.astype(float)))
    times = _stamps_of(observed)
    if times is None:
        return kernels
    apart = np.abs(times[:, None] - times)
    steps = np.diff(np.sort(times))
    shortest = float(np.median(steps))
    for time in SCATTER_TIMES:
        if shortest < time < np.ptp(times):
            scale = MINUTES if time < HOUR else HOURS
            kernels.append(_Kernel(scale, _root(np.exp(-apart / time))))
    return kernels


def _lengths_of_fields(axes: int) -> list[Array]:
    """Return the lengths of the losses along so many axes, shape (axes,) each."""
    fields = [np.full(axes, length) for length in FIELD_LENGTHS]
    narrow, wide = RESONANCE_LENGTHS
    for axis in range(axes):
        lengths = np.full(axes, wide)
        lengths[axis] = narrow
        fields.append(lengths)
    return fields


def _root(covariance: Array) -> Array:
    """Return a matrix whose product with its transpose is a covariance, shape (n, n)."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(values.clip(0.0)))


class _Evidence:
    """Log evidence of what scatters, against noise as stated and nothing else.

    Args:
        rows: of a refit with the noise held at its statement.
    """

    def __init__(self, rows: RowsAtStatement) -> None:
        self.rows = rows
        self.observed = rows.fit.observed

    def of_channel(self) -> float:
        """Return the log evidence of a noise of the first channel that is stated too small."""
        return self._of_first_channel(np.eye(len(self.observed)))

    def of_base_model(self) -> float:
        """Return the log evidence of a base model whose first channel is smoothly off."""
        return self._of_first_channel(self.observed.smooth.at_campaign)

    def of_field(self, lengths: Array) -> float:
        """Return the log evidence of a loss that is a smooth field over the axes.

        Args:
            lengths: over which it changes, as a part of the range of each axis, shape (axes,).
        """
        scaled = (scaled_to_extent(self.observed.coordinates) + 1.0) / 2.0
        apart = (scaled[:, :, None] - scaled[:, None, :]) / lengths[:, None, None]
        covariance = np.exp(-0.5 * np.sum(apart**2, axis=0))
        for axis in self.observed.axes:
            if axis.labels:
                values = self.observed.points[axis.name]
                covariance = covariance * (values[:, None] == values)
        return self._of_first_channel(_root(covariance))

    def _of_first_channel(self, columns: Array) -> float:
        """Return the log evidence of changes of the first channel, shape (n, m)."""
        changes = np.zeros((*self.rows.fit.whitened.shape, columns.shape[1]))
        changes[0] = columns
        return self.of_changes(changes)

    def of_quantity(self, signature: Array, root: Array) -> float:
        """Return the log evidence of a quantity that varies.

        Args:
            signature: change of every reading, in stated deviations, shape (channels, n).
            root: of its covariance over the tests, shape (n, m).
        """
        return self.of_changes(signature[..., None] * root)

    def of_changes(self, changes: Array) -> float:
        """Return the log evidence of coefficients of one amplitude, averaged over a grid.

        Args:
            changes: of the readings by each coefficient, in deviations, shape (channels, n, m).
        """
        from scipy.special import logsumexp

        residuals = self.rows.residuals
        absorbed = self.rows.absorbed
        columns = np.zeros((len(residuals), changes.shape[-1]))
        of_readings = (changes * self.rows.unit[..., None]).reshape(
            -1, changes.shape[-1]
        )
        columns[: len(of_readings)] = of_readings
        left = columns - absorbed @ (absorbed.T @ columns)
        size = np.sqrt(np.sum(left**2) / len(self.observed))
        if size == 0.0:
            return -np.inf
        left /= size
        values, vectors = np.linalg.eigh(left.T @ left)
        values = values.clip(0.0)
        along = vectors.T @ (left.T @ residuals)
        gains = []
        for amplitude in SCATTER_AMPLITUDES:
            variance = amplitude**2
            spread = 1.0 + variance * values
            gains.append(0.5 * np.sum(variance * along**2 / spread - np.log(spread)))
        return float(logsumexp(gains) - np.log(len(gains)))


def _summary(
    rivals: Sequence[_Rival],
    unrecorded: Sequence[Unrecorded],
    kernels: Sequence[_Kernel],
    agreement: Agreement,
    observed: Observations,
) -> ExcessScatter:
    """Return the statement: rivals of one quantity, and of one time scale, share a prior evenly."""
    from scipy.special import softmax

    log_weights = []
    for rival in rivals:
        log_weights.append(rival.log_evidence - np.log(_alike(rival, rivals, kernels)))
    weights = softmax(log_weights).tolist()
    quantities: dict[str, float] = {}
    time_scales: dict[str, float] = {}
    for rival, weight in zip(rivals, weights, strict=True):
        quantities[rival.quantity] = quantities.get(rival.quantity, 0.0) + weight
        scale = rival.time_scale
        if scale is not None:
            time_scales[scale] = time_scales.get(scale, 0.0) + weight
    ranked = sorted(quantities.items(), key=lambda item: -item[1])
    relevant = tuple(item for item in ranked if item[1] >= RELEVANT_PROBABILITY)
    likeliest = max(time_scales, key=time_scales.__getitem__)
    is_known = len(kernels) > 1 and time_scales[likeliest] >= LIKELY
    time_scale = likeliest if is_known else None
    sensors = {item.name: item.sensor for item in unrecorded}
    sensor = next((sensors[name] for name, _ in ranked if name in sensors), "")
    return ExcessScatter(
        ratio=agreement.ratio,
        channel=observed.channels[0].name,
        time_scale=time_scale,
        quantities=relevant,
        sensor=sensor,
        sentence=_sentence(agreement, time_scale, relevant, sensors),
    )


def _alike(rival: _Rival, rivals: Sequence[_Rival], kernels: Sequence[_Kernel]) -> int:
    """Return among how many rivals the prior of a quantity is shared."""
    if rival.quantity == UNLISTED:
        return sum(item.quantity == UNLISTED for item in rivals)
    if rival.quantity in _RIVALS:
        return 1
    scales = {kernel.time_scale for kernel in kernels}
    of_scale = sum(kernel.time_scale == rival.time_scale for kernel in kernels)
    return len(scales) * of_scale


def _sentence(
    agreement: Agreement,
    time_scale: str | None,
    quantities: Sequence[tuple[str, float]],
    sensors: dict[str, str],
) -> str:
    """Return both branches: a wrong statement, or something that varied and what would show it."""
    of_quantities = dict(quantities)
    of_axes = of_quantities.get(BASE_MODEL, 0.0) + of_quantities.get(UNLISTED, 0.0)
    wrong = f"the noise is stated {agreement.ratio:.2g} times too small"
    if agreement.of_meters_alone:
        wrong = "a meter is outside its class"
    if of_axes > LIKELY:
        return (
            f"It follows the axes ({probability(of_axes)}): the base model is off, or a loss is "
            f"missing; or {wrong}, or something varied that was not recorded."
        )
    known = [(name, p) for name, p in quantities if name in sensors]
    over = "" if time_scale is None else f" {_OVER[time_scale]}"
    varied = f"something varied{over} that was not recorded"
    if known:
        named = [f"{name} ({probability(p)})" for name, p in known[:2]]
        varied += f", perhaps {listed(named)}: record {sensors[known[0][0]]}"
    return f"Either {wrong}, or {varied}."
