# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which samples a diagnosis can use; impossible points and slips are left out and named.

A gap has neighbours: points close by share it. A slip stands alone. A sample is called an outlier
when its residual lies far from the median of its nearest neighbours', measured by how far samples
usually lie; and only if such samples are few, because many together are a narrow gap.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .fitting.hypothesis import Hypothesis
from .fitting.refit import Fit, refit
from .observations import Observations, replicate_groups, scaled_to_extent
from .settings import (
    LEAST_SAMPLES,
    MAD_TO_DEVIATION,
    MOST_SAMPLES,
    MOST_WITHOUT_ANSWER,
    NAMED_SAMPLES,
    OUTLIER_CLUSTER_P,
    OUTLIER_DISTANCE,
    OUTLIER_LEAST_SCALE,
    OUTLIER_MOST_PART,
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


def prepare(system: System, observed: Observations) -> tuple[Fit, list[str]]:
    """Refit the base model to what can be used, and return a note on every sample left out.

    Of a large campaign as many as can be weighed are kept.

    Raises:
        InputError: what remains cannot carry a diagnosis.
    """
    notes: list[str] = []
    base = _loosened(_answered(system, observed, notes))
    observed = base.observed
    slips, read = outliers(observed, base.whitened), observed.channels[0].name
    if len(slips) > NAMED_SAMPLES:
        notes.append(
            f"{len(slips)} samples stand alone against their neighbours and were left "
            f"out: {describe_samples(observed, slips)}"
        )
    else:
        notes += [
            f"{observed.describe(i)}, {read} {observed.measured[0, i]:.4g}, stands alone "
            "against its neighbours and was left out: measure it again"
            for i in slips
        ]
    if len(slips):
        base = _answered(system, observed.without(slips), notes)
    _check(system, base.observed)
    if len(base.observed) > MOST_SAMPLES:
        notes.append(
            f"{MOST_SAMPLES} of {len(base.observed)} samples are weighed, evenly spread over the "
            "operating points"
        )
        base = refit(
            base.hypothesis,
            base.observed.select(spread_out(base.observed, MOST_SAMPLES)),
            base.base,
        )
    uneven = uneven_noise(base)
    changing = np.flatnonzero(np.ptp(uneven, axis=1))
    notes += [
        f"the scatter of {base.observed.channels[i].name} seems to change "
        f"{uneven[i].max() / uneven[i].min():.1f}-fold over the operating points, or a gap "
        "is narrow; samples count by it, and a column of standard deviations would state it"
        for i in changing
    ]
    if len(changing):
        observed = base.observed
        base = refit(
            base.hypothesis,
            replace(observed, deviation=observed.deviation * uneven),
            base.base,
        )
    return base, notes


def _answered(system: System, observed: Observations, notes: list[str]) -> Fit:
    """Refit the base to the samples to which it has an answer.

    Those judge that have one before any refit: a refit to all would bend until it carries loads
    that were never there.
    """
    base = Hypothesis(system)

    def refused(theta: Array) -> NDArray[np.intp]:
        return np.flatnonzero(np.isnan(base.predict(theta, observed.points)[0]))

    fit, impossible = None, (before := refused(base.prior_mean))
    if len(before) < len(observed):
        fit = refit(base, observed.without(before))
        impossible = refused(fit.theta)
    if len(impossible) > MOST_WITHOUT_ANSWER * len(observed):
        raise InputError(
            f"{observed.samples.source}: {len(impossible)} of {len(observed)} samples "
            f"{system.refusal}, whatever its parameters (first: "
            f"{observed.describe(impossible[0])}): {system.advice}"
        )
    if len(impossible):
        notes.append(
            f"{len(impossible)} samples {system.refusal} and were left out: "
            f"{describe_samples(observed, impossible)}"
        )
    if fit is not None and np.array_equal(impossible, before):
        return fit
    return refit(base, observed.without(impossible))


def _loosened(fit: Fit) -> Fit:
    """Refit with the noise of readings that turn near their points."""
    hypothesis, observed = fit.hypothesis, fit.observed
    at = fit.theta, observed.points, observed.channels
    turning = hypothesis.local_variation(*at, hypothesis.predict(*at))
    if not turning.any():
        return fit
    loose = replace(observed, deviation=np.hypot(observed.deviation, turning))
    return refit(hypothesis, loose, fit.theta)


def spread_out(observed: Observations, most: int) -> NDArray[np.intp]:
    """Return the indices of so many samples, as evenly spread as can be: shape (most,), in order.

    Cells of a lattice, the finest of which no more are occupied, give one sample each in turn.
    """
    place = (scaled_to_extent(observed.coordinates).T + 1.0) / 2.0
    cell, parts = np.zeros(len(place), dtype=np.intp), 2.0
    while parts < THINNING_FINEST:
        code = (place * parts).astype(int) @ (int(parts) + 1) ** np.arange(
            place.shape[1]
        )
        finer = np.unique(code, return_inverse=True)[1]
        if finer.max() >= most:
            break
        cell, parts = finer, THINNING_REFINEMENT * parts
    mixed = np.random.default_rng(0).permutation(len(cell))
    # Of their cells the ends of the campaign come first: what is measured is no extrapolation.
    mixed = mixed[
        np.argsort(
            ~np.any((place == 0.0) | (place == 1.0), axis=1)[mixed], kind="stable"
        )
    ]
    order = mixed[np.argsort(cell[mixed], kind="stable")]
    turn = np.arange(len(cell)) - np.searchsorted(cell[order], cell[order])
    return np.sort(order[np.argsort(turn, kind="stable")[:most]])


def _check(system: System, observed: Observations) -> None:
    source, n, free = observed.samples.source, len(observed), len(system.base)
    against = f"cannot tell a gap from the {free} parameters that are refitted"
    least = max(LEAST_SAMPLES, free + 1)
    if n < least:
        raise InputError(
            f"{source}: {n} samples (rows that differ) {against}; at least {least} "
            "are needed"
        )
    points = replicate_groups(observed.axes, observed.points).max() + 1
    if points <= free:
        raise InputError(f"{source}: {points} distinct operating points {against}")


def uneven_noise(fit: Fit) -> Array:
    """How the noise that nobody states changes over the operating points, shape (channels, n).

    Its logarithm is linear in the place, or in the logarithm of what is positive, as for a meter
    that errs by a constant (Harvey 1976, Econometrica 44, 461), by what a refit and anything
    smooth, a gap above all, leave of the residuals. 1 where they do not show that (Akaike's
    criterion), lie at too few points, or pass what was assumed; else of mean square 1.
    """
    from scipy.optimize import minimize

    observed, shape = fit.observed, np.ones_like(fit.whitened)
    place = scaled_to_extent(
        np.stack(
            [np.log(row) if row.min() > 0.0 else row for row in observed.coordinates]
        )
    )
    place = np.vstack([np.ones(len(observed)), place])
    points = replicate_groups(observed.axes, observed.points).max() + 1
    for i, channel in enumerate(observed.channels):
        columns = np.hstack([observed.smooth[0], fit.jacobian[i]])
        # What is propagated from its meters, sample by sample, has the shape that it has.
        if (
            observed.prior_dof[i] > PRIOR_DOF_ASSUMED
            or channel.uncertainty == 0.0
            or points < UNEVEN_NOISE_POINTS * columns.shape[1]
        ):
            continue
        for _ in range(
            UNEVEN_NOISE_ROUNDS
        ):  # noise that is large somewhere bends what is taken elsewhere
            taken, _ = np.linalg.qr(columns / shape[i, :, None])
            left = fit.whitened[i] / shape[i]
            left = left - taken @ (taken.T @ left)
            free = 1.0 - np.sum(taken**2, axis=1)  # of each residual, what is not taken
            flat = np.log(np.sum(left**2) / free.sum())
            found = minimize(
                _deviance,
                np.append(flat, np.zeros(len(place) - 1)),
                (place, free, left**2),
                jac=True,
            )
            # Scatter beyond what was assumed is hardly noise.
            if flat > 0.0 or not free.sum() * (flat + 1.0) - found.fun > 2.0 * (
                len(place) - 1
            ):
                break
            shape[i] *= np.exp(0.5 * found.x @ place)
        shape[i] /= np.sqrt(np.mean(shape[i] ** 2))
    return shape


def _deviance(
    slopes: Array, place: Array, free: Array, squares: Array
) -> tuple[float, Array]:
    """-2 log likelihood of variances exp(slopes @ place), and its gradient."""
    log = slopes @ place
    ratio = squares * np.exp(-log)
    return float(np.sum(free * log + ratio)), place @ (free - ratio)


def describe_samples(observed: Observations, rows: NDArray[np.intp]) -> str:
    """Return the first few of some samples by number and operating point."""
    named = ", ".join(observed.describe(i) for i in rows[:NAMED_SAMPLES])
    return named + (" and others" if len(rows) > NAMED_SAMPLES else "")


def outliers(observed: Observations, whitened: Array) -> NDArray[np.intp]:
    """Return the indices of outliers, usually none.

    Args:
        observed: the bench.
        whitened: residuals of the refitted base model, shape (channels, n).
    """
    from scipy.spatial import cKDTree

    n = whitened.shape[1]
    if n < SMALL_CAMPAIGN:
        return np.array([], dtype=np.intp)
    place = scaled_to_extent(observed.coordinates)
    nearest = cKDTree(place.T).query(place.T, OUTLIER_NEIGHBOURS + 1)[1][:, 1:]
    flagged, most = np.zeros(n, dtype=bool), max(1, int(OUTLIER_MOST_PART * n))
    for row in whitened:
        apart = row - np.median(row[nearest], axis=1)
        usual = MAD_TO_DEVIATION * np.median(np.abs(apart - np.median(apart)))
        far = np.abs(apart) > OUTLIER_DISTANCE * max(float(usual), OUTLIER_LEAST_SCALE)
        if far.sum() > most:  # one that is far off bends the fit at the others
            far = np.abs(apart) > OUTLIER_RATIO * np.sort(np.abs(apart))[-1 - most]
        if not _together(place[:, far], place):
            flagged |= far
    return np.flatnonzero(flagged)


def _together(some: Array, place: Array) -> bool:
    """Whether some of very many places lie in a part of the range: a gap narrower than a cell."""
    if place.shape[1] <= MOST_SAMPLES or some.shape[1] < 2:
        return False
    from scipy.stats import ks_2samp

    return any(
        ks_2samp(one, row).pvalue < OUTLIER_CLUSTER_P
        for one, row in zip(some, place, strict=True)
    )
