# SPDX-License-Identifier: Apache-2.0
"""A diagnosis as one self-contained HTML page; it loads nothing and needs no script."""

from __future__ import annotations

import os
from pathlib import Path

from ..diagnosis import words
from ..diagnosis.result import GAP_SIGNIFICANCE, Diagnosis
from ..files.atomic import write_atomically
from .page import causes, gap_map, residual_plot, svg, tables, watts
from .page.style import PATTERNS, STYLE

_BADGES = {"no_gap": "No gap", "cause_found": "Cause found", "ambiguous": "Ambiguous",
           "unexplained": "Unexplained"}
# The page itself forbids what it promises not to do.
_POLICY = "default-src 'none'; style-src 'unsafe-inline'"


def write_html(diagnosis: Diagnosis, path: str | os.PathLike[str]) -> None:
    """Write the page of a diagnosis, whole or not at all.

    Raises:
        OSError: the folder cannot be written or is full; an old file is untouched.
    """
    write_atomically(Path(path), html(diagnosis))


def html(diagnosis: Diagnosis) -> str:
    """Return the page of a diagnosis; the same diagnosis gives the same text."""
    source = diagnosis.samples.source.rsplit("/", 1)[-1]
    head = "\n".join([
        '<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f'<meta http-equiv="Content-Security-Policy" content="{svg.text(_POLICY)}">',
        svg.element("title", svg.text(f"Gap diagnosis of {source}")),
        f"<style>{STYLE}</style>",
    ])
    body = "\n".join([PATTERNS, _top(diagnosis, source),
                      svg.element("main", _cards(diagnosis), *_sections(diagnosis))])
    return (f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head}\n</head>\n<body>\n{body}\n'
            "</body>\n</html>\n")


def _top(found: Diagnosis, source: str) -> str:
    return svg.element(
        "header", svg.element("h1", svg.text(f"Model against bench: {source}")),
        svg.element("div", _BADGES[found.verdict], class_="badge"),
        svg.element("p", svg.text(words.verdict(found)), class_="verdict"),
        svg.element("p", svg.text(words.remark(found)), class_="lead"), class_="top")


def _cards(found: Diagnosis) -> str:
    gap, shrunk = found.gap, found.shrinkage
    cards = [
        ("Gap above the noise", words.points(shrunk.before),
         "rms of measured minus predicted, base refitted"),
        ("Noise", words.points(gap.noise),
         f"before the fit {words.points(gap.noise_stated)}: {gap.noise_source}"),
        ("Chance alone", words.p_is(gap.p_value),
         f"{'' if gap.significant else 'not '}significant: the limit is {GAP_SIGNIFICANCE:g}"),
    ]
    if found.verdict != "no_gap":
        cards.append(_shrinkage_card(found))
        cards.append(("Part", found.component or "not known",
                      "where the leading cause acts" if found.component else "no cause is named"))
    cards.append(("Samples", str(gap.samples), "steady operating points"))
    return svg.element("div", *(svg.element(
        "div", *(svg.element("span", svg.text(value), class_=kind)
                 for kind, value in zip(("name", "value", "more"), card, strict=True)),
        class_="card") for card in cards), class_="cards")


def _shrinkage_card(found: Diagnosis) -> tuple[str, str, str]:
    shrunk = found.shrinkage
    if shrunk.fraction is None:
        return "Gap removed", "not known", "too little gap to measure it"
    value = words.percent(shrunk.fraction) if shrunk.fraction > 0.0 else "none"
    span = ("" if shrunk.interval is None
            else f", 95 % interval {words.fraction_interval(shrunk.interval)}")
    return "Gap removed", value, f"squared, on {shrunk.on}{span}"


def _sections(found: Diagnosis) -> list[str]:
    parts = [("Where the gap lies", _map(found)), ("Residuals before and after", _plot(found)),
             ("Candidate causes", _causes(found)), ("Where the watts go", _watts(found)),
             ("What to measure next", _next(found)), ("Notes and data", _notes(found))]
    return [svg.element("section", svg.element("h2", f"{number}. {title}"), body)
            for number, (title, body) in enumerate(parts, 1)]


def _map(found: Diagnosis) -> str:
    note = gap_map.residuals(found).note
    what = ("Each mark is the mean of the samples in one cell of the view"
            if gap_map.condensed(found) else "Each mark is one sample")
    caption = (f"{what}: measured minus predicted efficiency, {note}. A place that spans a "
               "whole view is not drawn in it; a dashed one may be chance.")
    if not found.where:
        caption += " No place differs from the model more than chance allows."
    return (svg.element("div", *gap_map.maps(found), class_="figures") + gap_map.legend(found)
            + _caption(caption) + tables.places(found))


def _plot(found: Diagnosis) -> str:
    plot = residual_plot.residual_plot(found)
    caption = ("Measured minus predicted efficiency at samples "
               + ("of the holdout" if found.shrinkage.on == "holdout" else "left out of the fit")
               + f". Grey band: twice the noise, ± {words.points(2.0 * found.gap.noise)}; about "
               "95 of 100 samples lie in it when nothing but noise is left. Black line: running "
               "mean, where there are samples enough.")
    if plot.beyond:
        caption += f" Open triangles: {plot.beyond} beyond the scale."
    if plot.thinned:
        caption += " A part of the samples is drawn, evenly picked."
    return svg.element("div", *plot.drawings, class_="figures") + _caption(caption)


def _causes(found: Diagnosis) -> str:
    if not found.causes:
        return svg.element("p", "There is no gap, so no cause is sought."
                           if found.verdict == "no_gap" else "No cause is left to be named.")
    intro = ("Probability that each effect is present, given these samples. Causes in one bracket "
             "explain them about equally well: adding any of them gives nearly the same model.")
    return svg.element("p", intro, class_="caption") + causes.ranked(found)


def _watts(found: Diagnosis) -> str:
    shares = watts.watts(found)
    added = found.model is not found.base
    caption = (f"At the median engine speed, {words.rpm(shares.engine_speed)} r/min "
               f"({words.fixed(shares.engine_speed, 1)} rad/s), and the median load torque, "
               f"{words.fixed(shares.load_torque, 0)} N·m. The table gives means over the bars. "
               f"{_offsets(found)}")
    if added and not set(shares.after) - set(shares.before):
        caption += (" The effect takes no share of its own: it acts through the parts shown, or "
                    "on the readings of the bench.")
    return (svg.element("div", *watts.drawings(found, shares), class_="figures")
            + watts.legend(shares) + _caption(caption)
            + tables.watts(watts.means(shares), added))


def _offsets(found: Diagnosis) -> str:
    """Say what no part takes: a shift of all readings, booked as calibration of the meters."""
    shifts = [words.points(gap_map.shared(found, model), sign=True)
              for model in (found.base, found.model)]
    both = f"{shifts[0]} before, {shifts[1]} after" if found.model is not found.base else shifts[0]
    return (f"Measured minus predicted, mean of all samples: {both}; such a shared part may be "
            "calibration of the meters and is in no bar.")


def _next(found: Diagnosis) -> str:
    body = tables.next_tests(found)
    if not any(test.engine_speed is not None for test in found.next_tests):
        return body
    return body + _caption(
        "Gain: how far, in squared standard deviations of the readings, the test is expected to "
        "speak against the wrong one of the two; 9 in all settles the question.")


def _notes(found: Diagnosis) -> str:
    notes = [svg.element("li", svg.text(f"{note[:1].upper()}{note[1:]}.")) for note in found.notes]
    listing = svg.element("ul", *notes, class_="notes") if notes else ""
    return listing + tables.provenance(found) + svg.element(
        "h3", "How to read this page") + "".join(svg.element("p", line) for line in _HELP)


def _caption(words_: str) -> str:
    return svg.element("p", svg.text(words_), class_="caption")


_HELP = (
    "Efficiency is output power / engine power. Differences are given in points: 0.80 against "
    "0.81 is 1 point. Load torque is output power / engine speed.",
    "Before anything is judged, the three base parameters (leakage, motor damping, pump damping) "
    "are fitted to these samples again: a gap that such a refit closes is none. What remains "
    "beyond the noise is the gap.",
    "The part of the gap removed is counted in squared differences above the noise, on samples "
    "that the fit has not seen. 75 % of the squared gap removed leaves half of its rms value.",
    "A probability holds within the library of effects and its entry for effects that nobody "
    "listed. A fitted size comes with the interval that holds it in 95 of 100 cases if the effect "
    "is the right one; a size called implausible speaks against the effect.",
    "A base parameter that drifts by more than two standard errors when an effect is added has "
    "been covering for it.",
)
