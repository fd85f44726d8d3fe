# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Selection and weighting of the samples that a diagnosis uses, with a note on what changes.

A real gap has neighbours: nearby operating points share it. A slip stands alone. A sample is an
outlier when its residual lies far from the median of its nearest neighbours' residuals, relative
to how far samples usually lie, and only if such samples are few: many together are a narrow gap.
Noise is widened near changes of operating mode, and where the scatter is uneven.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .fitting.hypothesis import Hypothesis
from .fitting.refit import Fit, refit
from .observations import (
    Observations,
    replicate_groups,
    scaled_to_extent,
    tie_free,
)
from .settings import (
    HIGHEST_MISFIT,
    HIGHEST_SENSITIVITY,
    MAD_TO_DEVIATION,
    MAX_OUTLIER_FRACTION,
    MAX_SAMPLES,
    MAX_WITHOUT_ANSWER,
    MIN_OUTLIER_SCALE,
    MIN_SAMPLES,
    NAMED_SAMPLES,
    OUTLIER_CLUSTER_P,
    OUTLIER_DISTANCE,
    OUTLIER_NEIGHBOURS,
    OUTLIER_RATIO,
    PRIOR_DOF_ASSUMED,
    SMALL_CAMPAIGN,
    THINNING_FINEST,
    THINNING_REFINEMENT,
    UNEVEN_NOISE_POINTS,
    UNEVEN_NOISE_ROUNDS,
)
from .system import Array, System

Index = NDArray[np.intp]


class Prepared(NamedTuple):
    """A campaign that is ready for a diagnosis.

    Attributes:
        base: the refit of the base model, whose `observed` are the samples used.
        notes: on what was left out or reweighted.
        outliers: samples that stand alone against their neighbours and were left out, in words.
    """

    base: Fit
    notes: list[str]
    outliers: tuple[str, ...] = ()


def prepare(system: System, observed: Observations) -> Prepared:
    """Refit the base model to the samples that can be used.

    Args:
        system: on the bench.
        observed: all samples.

    Raises:
        InputError: what remains cannot carry a diagnosis, or is too far from the model.
    """
    base, notes = _refit_to_answered(system, observed)
    base = _with_transition_noise(base)
    observed = base.observed
    slips = outliers(observed, base.whitened)
    described = tuple(observed.describe(i) for i in slips)
    if len(slips):
        notes += _outlier_notes(observed, slips)
        base, further_notes = _refit_to_answered(system, observed.without(slips))
        notes += further_notes
    _check_count(system, base.observed)
    _check_scale(base)
    if len(base.observed) > MAX_SAMPLES:
        notes.append(
            f"{MAX_SAMPLES} of {len(base.observed)} samples are weighed, evenly spread over the "
            "operating points"
        )
        kept = spread_out(base.observed, MAX_SAMPLES)
        base = refit(base.hypothesis, base.observed.select(kept), base.theta)
    base, further_notes = _with_uneven_noise(base)
    return Prepared(base, notes + further_notes, described)


def _check_scale(fit: Fit) -> None:
    """Refuse readings or base parameters so far off that the digits of squares are lost."""
    base = fit.hypothesis.system.base
    changes = fit.jacobian[..., : len(base)] * base.spread
    sensitivity = np.sqrt(np.mean(changes**2, axis=(0, 1)))
    widest = int(sensitivity.argmax())
    if sensitivity[widest] > HIGHEST_SENSITIVITY:
        raise InputError(
            f"one prior standard deviation of {base.names[widest]} changes the readings by "
            f"{sensitivity[widest]:.2g} times their noise, more than {HIGHEST_SENSITIVITY:.0e}: "
            "check the units of the axes and the noise"
        )
    misfits = np.sqrt(np.mean(fit.whitened**2, axis=1))
    worst = int(misfits.argmax())
    if misfits[worst] > HIGHEST_MISFIT:
        channel = fit.observed.channels[worst]
        raise InputError(
            f"{channel.name} lies {misfits[worst]:.2g} standard deviations from the refitted "
            f"model, more than {HIGHEST_MISFIT:.0e}: check its noise, its unit ({channel.unit}) "
            "and those of the axes"
        )


# --- samples without an answer --------------------------------------------------------------


def _refit_to_answered(system: System, observed: Observations) -> tuple[Fit, list[str]]:
    """Refit the base model to the samples for which it has an answer.

    Only samples the unfitted model can answer are used at first. A refit to all of them would
    bend the parameters until the model carries loads that were never there.
    """
    hypothesis = Hypothesis(system, shared_count=observed.shared_count)
    unanswered_before = _unanswered(hypothesis, observed, hypothesis.prior_mean)
    if len(observed) and len(unanswered_before) == len(observed):
        raise _too_few_answers(system, observed, unanswered_before)
    fit = refit(hypothesis, observed.without(unanswered_before))
    unanswered = _unanswered(hypothesis, observed, fit.theta)
    if len(unanswered) > MAX_WITHOUT_ANSWER * len(observed):
        raise _too_few_answers(system, observed, unanswered)
    notes = []
    if len(unanswered):
        notes.append(
            f"{len(unanswered)} samples {system.refusal} and were left out: "
            f"{describe_samples(observed, unanswered)}"
        )
    if not np.array_equal(unanswered, unanswered_before):
        fit = refit(hypothesis, observed.without(unanswered), fit.theta)
    return fit, notes


def _unanswered(hypothesis: Hypothesis, observed: Observations, theta: Array) -> Index:
    """Return the samples at which the first channel has no answer."""
    predicted = hypothesis.predict(theta, observed.points)[0]
    return np.flatnonzero(np.isnan(predicted))


def _too_few_answers(
    system: System, observed: Observations, unanswered: Index
) -> InputError:
    return InputError(
        f"{observed.samples.source}: {len(unanswered)} of {len(observed)} samples "
        f"{system.refusal}, whatever its parameters (first: "
        f"{observed.describe(unanswered[0])}): {system.advice}"
    )


def _check_count(system: System, observed: Observations) -> None:
    """Refuse a campaign that cannot separate a gap from the base parameters."""
    source = observed.samples.source
    n = len(observed)
    # Errors of meters around a machine that is held are no parameters to be identified.
    parameters = getattr(system, "identified", len(system.base))
    reason = f"cannot tell a gap from the {parameters} parameters that are refitted"
    least = max(MIN_SAMPLES, parameters + 1)
    if n < least:
        raise InputError(
            f"{source}: {n} samples (rows that differ) {reason}; at least {least} are needed"
        )
    points = _distinct_points(observed)
    if points <= parameters:
        raise InputError(f"{source}: {points} distinct operating points {reason}")


def _distinct_points(observed: Observations) -> int:
    return int(replicate_groups(observed.axes, observed.points).max()) + 1


def describe_samples(observed: Observations, rows: Index) -> str:
    """Return the first few of some samples by number and operating point."""
    described = ", ".join(observed.describe(i) for i in rows[:NAMED_SAMPLES])
    if len(rows) > NAMED_SAMPLES:
        return f"{described} and others"
    return described


# --- noise that depends on the operating point ----------------------------------------------


def _with_transition_noise(fit: Fit) -> Fit:
    """Refit with wider noise for readings close to a change of operating mode."""
    hypothesis = fit.hypothesis
    observed = fit.observed
    predicted = hypothesis.predict(fit.theta, observed.points, observed.channels)
    variation = hypothesis.local_variation(
        fit.theta, observed.points, observed.channels, predicted
    )
    if not variation.any():
        return fit
    wider = replace(observed, deviation=np.hypot(observed.deviation, variation))
    return refit(hypothesis, wider, fit.theta)


def _with_uneven_noise(base: Fit) -> tuple[Fit, list[str]]:
    """Refit with noise that changes over the operating points, with notes on it."""
    observed = base.observed
    factors = uneven_noise(base)
    uneven_channels = np.flatnonzero(np.ptp(factors, axis=1))
    if not len(uneven_channels):
        return base, []
    notes = []
    for i in uneven_channels:
        ratio = factors[i].max() / factors[i].min()
        notes.append(
            f"the scatter of {observed.channels[i].name} seems to change {ratio:.1f}-fold over "
            "the operating points, or a gap is narrow; samples count by it, and a column of "
            "standard deviations would state it"
        )
    reweighted = replace(observed, deviation=observed.deviation * factors)
    return refit(base.hypothesis, reweighted, base.theta), notes


def uneven_noise(fit: Fit) -> Array:
    """Return how noise that is not stated changes over the operating points.

    The logarithm of the variance is linear in the coordinates, or in the logarithm of positive
    ones, as for a meter with a constant error (Harvey 1976, Econometrica 44, 461). It is fitted
    to what a refit and all smooth functions, above all a gap, leave of the residuals. Akaike's
    criterion decides whether a channel has such a variance.

    Args:
        fit: the refit of the base model.

    Returns:
        Factors of the standard deviations, of mean square 1 in each channel, shape (channels, n);
        1 where the noise is stated or even, or where there are too few points.
    """
    observed = fit.observed
    factors = np.ones_like(fit.whitened)
    regressors = _log_variance_regressors(observed)
    points = _distinct_points(observed)
    base_columns = fit.jacobian[..., : len(fit.base)]
    for i, channel in enumerate(observed.channels):
        nuisance = np.hstack([observed.smooth.at_campaign, base_columns[i]])
        # An assumed noise of a small campaign has more of them, and counts as stated too.
        stated = observed.prior_dof[i] > PRIOR_DOF_ASSUMED
        # Uncertainty propagated from meters has its shape already.
        propagated = channel.uncertainty == 0.0
        too_few = points < UNEVEN_NOISE_POINTS * nuisance.shape[1]
        if not (stated or propagated or too_few):
            factors[i] = _noise_factors(fit.whitened[i], nuisance, regressors)
    return factors


def _log_variance_regressors(observed: Observations) -> Array:
    """Return a constant and the scaled coordinates, in logarithms if positive, (1 + axes, n)."""
    rows = []
    for row in observed.coordinates:
        rows.append(np.log(row) if row.min() > 0.0 else row)
    scaled = scaled_to_extent(np.stack(rows))
    return np.vstack([np.ones(len(observed)), scaled])


def _noise_factors(residual: Array, nuisance: Array, regressors: Array) -> Array:
    """Fit the variance function of one channel by alternating with the nuisance functions.

    Args:
        residual: in deviations, shape (n,).
        nuisance: functions that are projected out of the residuals, shape (n, m).
        regressors: of the log variance, shape (k, n).

    Returns:
        Factors of the standard deviation, shape (n,).
    """
    from scipy.optimize import minimize

    factor = np.ones(len(residual))
    slopes = len(regressors) - 1
    # Noise that is large somewhere bends the nuisance functions elsewhere, hence the rounds.
    for _ in range(UNEVEN_NOISE_ROUNDS):
        basis, _ = np.linalg.qr(nuisance / factor[:, None])
        scaled = residual / factor
        remainder = scaled - basis @ (basis.T @ scaled)
        degrees_of_freedom = 1.0 - np.sum(basis**2, axis=1)
        even_variance = np.sum(remainder**2) / degrees_of_freedom.sum()
        even_log_variance = np.log(even_variance)
        fitted = minimize(
            _deviance,
            np.append(even_log_variance, np.zeros(slopes)),
            (regressors, degrees_of_freedom, remainder**2),
            jac=True,
        )
        even_deviance = degrees_of_freedom.sum() * (even_log_variance + 1.0)
        # Akaike's criterion: two for each further coefficient.
        improves = even_deviance - fitted.fun > 2.0 * slopes
        # Scatter beyond the assumed noise is hardly noise.
        exceeds_assumption = even_log_variance > 0.0
        if exceeds_assumption or not improves:
            break
        factor *= np.exp(0.5 * fitted.x @ regressors)
    return np.asarray(factor / np.sqrt(np.mean(factor**2)))


def _deviance(
    coefficients: Array,
    regressors: Array,
    degrees_of_freedom: Array,
    squares: Array,
) -> tuple[float, Array]:
    """Return -2 log likelihood of variances exp(coefficients @ regressors), and its gradient.

    Args:
        coefficients: shape (k,).
        regressors: shape (k, n).
        degrees_of_freedom: of each residual, shape (n,).
        squares: of the residuals, shape (n,).
    """
    log_variance = coefficients @ regressors
    ratio = squares * np.exp(-log_variance)
    deviance = float(np.sum(degrees_of_freedom * log_variance + ratio))
    return deviance, regressors @ (degrees_of_freedom - ratio)


# --- large campaigns ------------------------------------------------------------------------


def spread_out(observed: Observations, most: int) -> Index:
    """Return the indices of so many samples, as evenly spread as possible, in order.

    The samples are sorted into the cells of the finest lattice that has fewer occupied cells than
    samples are wanted. Each cell gives one sample in turn, samples at the edge of the campaign
    first, so that the kept samples have the extent of all.

    Args:
        observed: the campaign.
        most: how many samples to keep.

    Returns:
        Shape (most,).
    """
    position = (tie_free(observed.coordinates).T + 1.0) / 2.0
    cell = _lattice_cells(position, most)
    order = np.random.default_rng(0).permutation(len(cell))
    on_edge = np.any((position == 0.0) | (position == 1.0), axis=1)
    order = order[np.argsort(~on_edge[order], kind="stable")]
    by_cell = order[np.argsort(cell[order], kind="stable")]
    first_of_cell = np.searchsorted(cell[by_cell], cell[by_cell])
    turn = np.arange(len(cell)) - first_of_cell
    by_turn = by_cell[np.argsort(turn, kind="stable")]
    return np.sort(by_turn[:most])


def _lattice_cells(position: Array, most: int) -> Index:
    """Return the cell of each sample in the finest lattice of at most `most` occupied cells.

    Args:
        position: coordinates scaled to 0 ... 1, shape (n, axes).
        most: occupied cells.
    """
    cell = np.zeros(len(position), dtype=np.intp)
    parts = 2.0
    while parts < THINNING_FINEST:
        place_values = (int(parts) + 1) ** np.arange(position.shape[1])
        code = (position * parts).astype(int) @ place_values
        finer = np.unique(code, return_inverse=True)[1]
        if finer.max() >= most:
            break
        cell = finer
        parts *= THINNING_REFINEMENT
    return cell


# --- outliers -------------------------------------------------------------------------------


def _outlier_notes(observed: Observations, slips: Index) -> list[str]:
    if len(slips) > NAMED_SAMPLES:
        return [
            f"{len(slips)} samples stand alone against their neighbours and were left "
            f"out: {describe_samples(observed, slips)}"
        ]
    channel = observed.channels[0].name
    notes = []
    for i in slips:
        notes.append(
            f"{observed.describe(i)}, {channel} {observed.measured[0, i]:.4g}, stands alone "
            "against its neighbours and was left out: measure it again"
        )
    return notes


def outliers(observed: Observations, whitened: Array) -> Index:
    """Return the indices of outliers, usually none.

    Args:
        observed: the readings.
        whitened: residuals of the refitted base model, in deviations, shape (channels, n).
    """
    from scipy.spatial import cKDTree

    n = whitened.shape[1]
    if n < SMALL_CAMPAIGN:
        return np.array([], dtype=np.intp)
    position = tie_free(observed.coordinates)
    # The nearest neighbour of a sample is the sample itself.
    nearest = cKDTree(position.T).query(position.T, OUTLIER_NEIGHBOURS + 1)[1][:, 1:]
    is_outlier = np.zeros(n, dtype=bool)
    for residual in whitened:
        distance = residual - np.median(residual[nearest], axis=1)
        far = _far_off(distance)
        if not _clustered(position[:, far], position):
            is_outlier |= far
    return np.flatnonzero(is_outlier)


def _far_off(distance: Array) -> NDArray[np.bool_]:
    """Return which of the distances from their neighbours are outlying, shape (n,)."""
    spread = np.median(np.abs(distance - np.median(distance)))
    scale = max(float(MAD_TO_DEVIATION * spread), MIN_OUTLIER_SCALE)
    most = max(1, int(MAX_OUTLIER_FRACTION * len(distance)))
    far = np.abs(distance) > OUTLIER_DISTANCE * scale
    if far.sum() <= most:
        return far
    # One gross slip bends the fit at other samples: only what towers above them counts.
    largest_usual = np.sort(np.abs(distance))[-1 - most]
    return np.asarray(np.abs(distance) > OUTLIER_RATIO * largest_usual)


def _clustered(some: Array, position: Array) -> bool:
    """Return whether some of very many samples lie in one part of the range, as a gap does.

    Args:
        some: positions of the suspected outliers, shape (axes, k).
        position: of all samples, shape (axes, n).
    """
    from scipy.stats import ks_2samp

    if position.shape[1] <= MAX_SAMPLES or some.shape[1] < 2:
        return False
    for some_values, values in zip(some, position, strict=True):
        if ks_2samp(some_values, values).pvalue < OUTLIER_CLUSTER_P:
            return True
    return False
