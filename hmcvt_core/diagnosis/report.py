# SPDX-License-Identifier: Apache-2.0
"""A diagnosis as plain data and as text; nothing is computed here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..ranges import RPM

if TYPE_CHECKING:
    from .result import Cause, Diagnosis, NextTest

_VAGUE = 0.3  # probability below which the first cause is one among many
_SETTLED = 2.0  # standard errors from which a drift of a base parameter is worth a line


def to_dict(found: Diagnosis) -> dict[str, Any]:
    """Return the JSON object of the command's contract."""
    gap, shrunk = found.gap, found.shrinkage
    return {
        "gap": {"samples": gap.samples, "rmse": gap.rmse, "noise": gap.noise,
                "noise_stated": gap.noise_stated, "noise_source": gap.noise_source,
                "p_value": gap.p_value, "significant": gap.significant},
        "where": [{
            "displacement_ratio": list(region.displacement_ratio),
            "engine_speed": list(region.engine_speed),
            "load_torque": list(region.load_torque),
            "mean_residual": region.mean_residual, "samples": region.samples,
            "p_value": region.p_value, "channel": region.channel} for region in found.where],
        "component": found.component,
        "verdict": found.verdict,
        "causes": [_cause(cause) for cause in found.causes],
        "unlisted_probability": found.unlisted,
        "shrinkage": {"before": shrunk.before, "after": shrunk.after,
                      "fraction": shrunk.fraction,
                      "interval": None if shrunk.interval is None else list(shrunk.interval),
                      "on": shrunk.on},
        "next_tests": [{
            "displacement_ratio": test.displacement_ratio, "engine_speed": test.engine_speed,
            "load_torque": test.load_torque, "separates": list(test.separates),
            "gain": test.gain, "measure": test.measure} for test in found.next_tests],
        "notes": list(found.notes),
    }


def _cause(cause: Cause) -> dict[str, Any]:
    return {
        "effect": cause.effect,
        "form": cause.form,
        "component": cause.component,
        "probability": cause.probability,
        "indistinguishable_from": list(cause.indistinguishable_from),
        "together_with": cause.together_with,
        "parameters": cause.parameters,
        "gap_after": cause.gap_after,
        "shrinkage": cause.shrinkage,
        "drift": cause.drift,
        "summary": cause.summary,
        "source": cause.source,
        "remedy": cause.remedy,
    }


def headline(found: Diagnosis) -> str:
    """Return the outcome in one or two plain sentences."""
    gap = found.gap
    if found.verdict == "no_gap":
        return (f"No gap: after a refit of its three parameters the model meets the bench within "
                f"the noise of {points(gap.noise)} (p = {gap.p_value:.3g}).")
    size = (f"Model and bench differ by {points(found.shrinkage.before)} above the noise of "
            f"{points(gap.noise)} (p = {gap.p_value:.3g}).")
    if found.verdict == "unexplained":
        return f"{size} No listed effect explains it: look at where it lies."
    return f"{size} {_named(found)}"


def _named(found: Diagnosis) -> str:
    cause, fraction = found.causes[0], found.shrinkage.fraction
    if cause.probability < _VAGUE:
        likely = ", ".join(f"{each.effect.replace('_', ' ')} ({100 * each.probability:.0f} %)"
                           for each in found.causes[:3])
        return f"These samples cannot tell the cause; the likeliest are {likely}."
    name = cause.effect.replace("_", " ")
    if cause.together_with:
        name += f" together with {cause.together_with.replace('_', ' ')}"
    sentence = "Cause: " if found.verdict == "cause_found" else "Most probable cause: "
    sentence += f"{name} ({100 * cause.probability:.0f} %)"
    if cause.indistinguishable_from:
        twins = " or ".join(other.replace("_", " ") for other in cause.indistinguishable_from)
        sentence += f"; these data cannot rule out {twins}"
    if fraction is not None and fraction > 0.0:
        sentence += (f". Adding it removes {100 * fraction:.0f} % of the squared gap "
                     f"({found.shrinkage.on})")
    return sentence + "."


def points(value: float) -> str:
    """Return an efficiency difference in points."""
    return f"{100 * value:.2f} points"


def report(found: Diagnosis) -> str:
    """Return a diagnosis as text for a person."""
    lines = [headline(found), ""]
    gap = found.gap
    lines.append(f"gap        {gap.samples} samples, error of prediction {points(gap.rmse)} rms, "
                 f"noise {points(gap.noise)} (stated {points(gap.noise_stated)}: "
                 f"{gap.noise_source})")
    shrunk = found.shrinkage
    if shrunk.fraction is not None and shrunk.interval is not None:
        lines.append(f"shrinkage  {points(shrunk.before)} -> {points(shrunk.after)} above noise; "
                     f"squared: {100 * shrunk.fraction:.0f} % gone "
                     f"(95 %: {100 * shrunk.interval[0]:.0f} to {100 * shrunk.interval[1]:.0f}), "
                     f"on {shrunk.on}")
    lines += _where(found)
    lines += _causes(found)
    if found.next_tests:
        lines.append("next tests")
        lines += [f"  {_test(test)}" for test in found.next_tests]
    lines += [f"note: {note}" for note in found.notes]
    return "\n".join(lines)


def _where(found: Diagnosis) -> list[str]:
    if not found.where:
        return []
    lines = ["where      displacement ratio    engine speed [rad/s]   load torque [N m]"
             "   measured - model  samples  p"]
    for region in found.where:
        lines.append(
            f"           {_range(region.displacement_ratio, '.2f'):<21} "
            f"{_range(region.engine_speed, '.1f'):<22} {_range(region.load_torque, '.0f'):<19} "
            f"{100 * region.mean_residual:+6.2f} points  {region.samples:>9}  "
            f"{region.p_value:.3g}")
    return lines


def _range(limits: tuple[float, float], form: str) -> str:
    return f"{limits[0]:{form}} .. {limits[1]:{form}}"


def _causes(found: Diagnosis) -> list[str]:
    if not found.causes:
        return []
    lines = [f"causes     (an effect nobody listed: {100 * found.unlisted:.0f} %)"]
    for cause in found.causes:
        form = f", {cause.form}" if cause.form else ""
        lines.append(f"  {100 * cause.probability:3.0f} %  {cause.effect}{form}  "
                     f"[{cause.component}]")
        lines.append(f"         {cause.summary}")
        for name, entry in cause.parameters.items():
            if "interval" not in entry:
                continue
            low, high = entry["interval"]
            doubt = "" if entry["plausible"] else "  (implausible size)"
            lines.append(f"         {name} = {entry['value']:.3g} ({low:.3g} to {high:.3g}) "
                         f"{entry['unit']}{doubt}")
        for name, change in cause.drift.items():
            if abs(change["standard_errors"]) > _SETTLED:
                lines.append(f"         without it the refit moves {name} from "
                             f"{change['with_effect']:.3g} to {change['without_effect']:.3g} "
                             f"({change['standard_errors']:+.1f} standard errors)")
    return lines


def _test(test: NextTest) -> str:
    separates = f"separates {test.separates[0]} from {test.separates[1]}"
    if test.displacement_ratio is None or test.engine_speed is None or test.load_torque is None:
        return f"{test.measure}: {separates}"
    extra = f", reading {test.measure} too" if test.measure else ""
    return (f"displacement ratio {test.displacement_ratio:+.2f}, engine speed "
            f"{test.engine_speed:.1f} rad/s ({test.engine_speed / RPM:.0f} r/min), load torque "
            f"{test.load_torque:.0f} N m{extra}: {separates} (gain {test.gain:.1f})")
