# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Notes on the noise of a campaign: a wrong statement, or what a statement would change."""

from __future__ import annotations

import math

import numpy as np

from ..analysis import Analysis, rms
from ..detection.significance import significance
from ..fitting.refit import Fit, refit
from ..observations import Observations
from ..selection.explanation import Explanation
from ..settings import (
    METER_FAR_OFF,
    NOISE_AS_STATED,
    PARAMETER_FAR_OFF,
    ROUNDING,
    SMALL_CAMPAIGN,
)
from ..wording import plain


def base_notes(analysis: Analysis) -> tuple[str, ...]:
    """Name the base parameters that the readings move far from where they were expected."""
    explanation = analysis.posterior.base_only
    if analysis.significant and analysis.has_candidates:
        explanation, _ = analysis.leading
    return tuple(
        f"{plain(name)} of the base model lies {deviations:.2g} standard deviations from what was "
        "expected: check it, and the units of the readings"
        for name, deviations in parameters_far_off(explanation.fit).items()
    )


def parameters_far_off(fit: Fit) -> dict[str, float]:
    """Return deviations from their prior of the base parameters that are far off, by name."""
    base = fit.hypothesis.system.base
    deviations = np.abs(fit.base - base.mean) / base.spread
    far_off = {}
    for name, deviation in zip(base.names, deviations.tolist(), strict=True):
        if deviation >= PARAMETER_FAR_OFF:
            far_off[name] = deviation
    return far_off


def noise_notes(analysis: Analysis) -> tuple[str, ...]:
    """Return notes on noise unlike its statement, or on what a statement would change."""
    return (*_of_first_channel(analysis), *_of_further_channels(analysis))


def meters_far_off(explanation: Explanation) -> dict[str, float]:
    """Return scatter / that assumed of the meters of further channels that are far off, by name."""
    observed = explanation.fit.observed
    noise = explanation.plain_model.noise
    far_off = {}
    for channel, variance in zip(
        observed.channels[1:], noise[1:].tolist(), strict=True
    ):
        ratio = math.sqrt(variance)
        if ratio >= METER_FAR_OFF:
            far_off[channel.name] = ratio
    return far_off


def _of_further_channels(analysis: Analysis) -> tuple[str, ...]:
    """Name the meters whose readings scatter far beyond what is assumed of them."""
    explanation = analysis.posterior.base_only
    if analysis.significant:
        explanation, _ = analysis.posterior.entries[0]
    return tuple(
        f"{name} scatters {ratio:.2g} times as much as its meter should: check that meter first"
        for name, ratio in meters_far_off(explanation).items()
    )


def _of_first_channel(analysis: Analysis) -> tuple[str, ...]:
    """Compare the noise of the first channel with its statement."""
    observed = analysis.base.observed
    channel = observed.channels[0]
    stated = observed.stated_noise
    estimated = rms(analysis.noise)
    if noise_decides(observed):
        return (_significance_if_stated(analysis),)
    ratio = estimated / stated
    lowest, highest = NOISE_AS_STATED
    if lowest < ratio < highest:
        return ()
    if not observed.assumed:
        if ratio > 1.0:
            return ()  # a note of `statements.scatter`
        return (
            f"the noise looks {ratio:.2f} times the one stated ({observed.noise_source}): check "
            "the statement",
        )
    usual = channel.deviation(observed.measured[0])
    if np.ptp(observed.deviation[0] / usual) > ROUNDING:
        return ()  # no single number states noise that changes over the operating points
    return (
        f"the noise was not stated; it looks like {channel.factor * estimated:.2g} {channel.unit}, "
        f"{ratio:.2f} times what is assumed: --noise {estimated:.2g} states that",
    )


def noise_decides(observed: Observations) -> bool:
    """Whether the noise is assumed, and too few samples distinguish it from a gap."""
    return observed.assumed and len(observed) < SMALL_CAMPAIGN


def _significance_if_stated(analysis: Analysis) -> str:
    """Return a note on the p value that the assumed noise would give if it were stated."""
    base = analysis.base
    observed = base.observed
    channel = observed.channels[0]
    noise = float(f"{observed.stated_noise:.2g}")
    fit = refit(base.hypothesis, observed.with_stated_noise(noise), base.theta)
    p_value = significance(fit, analysis.boxes, analysis.seed).p_value
    return (
        f"the noise was not stated, and {len(observed)} samples cannot distinguish it from a gap: "
        f"the verdict rests on an assumption; if the noise is known to be "
        f"{channel.factor * noise:.2g} {channel.unit}, --noise {noise:g} gives p = "
        f"{p_value:.2g}"
    )
