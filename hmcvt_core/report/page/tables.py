# SPDX-License-Identifier: Apache-2.0
"""Tables of the page: places, next tests, watts, provenance."""

from __future__ import annotations

from collections.abc import Sequence

from ...diagnosis import words
from ...diagnosis.result import REGION_SIGNIFICANCE, Diagnosis, NextTest
from ...transmission.parameters import PARAMETER_UNITS
from . import svg


def table(
    head: Sequence[str], rows: Sequence[Sequence[str]], text_columns: int = 1,
    last_is_text: bool = False,
) -> str:
    """Return a table that scrolls in its own box; the first `text_columns` read as text."""
    def cell(name: str, place: int, content: str) -> str:
        words_ = place < text_columns or (last_is_text and place == len(head) - 1)
        scope = "col" if name == "th" else None
        return svg.element(name, svg.text(content), class_=None if words_ else "number",
                           scope=scope)

    top = svg.element("tr", *(cell("th", i, title) for i, title in enumerate(head)))
    body = "".join(svg.element("tr", *(cell("td", i, value) for i, value in enumerate(row)))
                   for row in rows)
    inner = svg.element("table", svg.element("thead", top), svg.element("tbody", body))
    return svg.element("div", inner, class_="scroll", tabindex=0)


def places(found: Diagnosis) -> str:
    """Return the regions in which the bench differs."""
    if not found.where:
        return ""
    rows = []
    for number, region in enumerate(found.where, 1):
        low, high = region.engine_speed
        chance = words.chance(region.p_value)
        if region.p_value > REGION_SIGNIFICANCE:
            chance += " (may be chance)"
        rows.append((
            str(number), words.points(region.mean_residual, sign=True),
            _span(region.displacement_ratio, 2), f"{words.rpm(low)} to {words.rpm(high)}",
            _span(region.engine_speed, 1), _span(region.load_torque, 0), str(region.samples),
            chance, words.plain(region.channel)))
    return table(("place", "efficiency, measured minus predicted, mean", "displacement ratio [-]",
                  "engine speed [r/min]", "engine speed [rad/s]", "load torque [N·m]", "samples",
                  "p", "seen best in"), rows, last_is_text=True)


def _span(limits: tuple[float, float], digits: int) -> str:
    return f"{words.fixed(limits[0], digits)} to {words.fixed(limits[1], digits)}"


def next_tests(found: Diagnosis) -> str:
    """Return the operating points to run and the measurements to make besides."""
    at_points = [test for test in found.next_tests if _has_point(test)]
    others = [test for test in found.next_tests if not _has_point(test)]
    parts = []
    if at_points:
        parts.append(table(
            ("test", "tells apart", "displacement ratio [-]", "engine speed [r/min]",
             "engine speed [rad/s]", "load torque [N·m]", "gain", "measure besides"),
            [_test(number, test) for number, test in enumerate(at_points, 1)], text_columns=2,
            last_is_text=True))
    if others:
        parts.append(svg.element("h3", "Measurements that no operating point replaces"))
        parts.append(svg.element("ul", *_measurements(others), class_="todo"))
    if not parts:
        parts.append(svg.element("p", _nothing_to_test(found.verdict)))
    return "".join(parts)


def _has_point(test: NextTest) -> bool:
    return None not in (test.displacement_ratio, test.engine_speed, test.load_torque)


def _test(number: int, test: NextTest) -> tuple[str, ...]:
    assert test.engine_speed is not None
    return (str(number), _separates(test), words.fixed(test.displacement_ratio, 2),
            words.rpm(test.engine_speed), words.fixed(test.engine_speed, 1),
            words.fixed(test.load_torque, 0), words.number(test.gain),
            words.plain(test.measure) if test.measure else words.NOTHING)


def _separates(test: NextTest) -> str:
    return " | ".join(words.plain(name) for name in test.separates)


def _measurements(tests: Sequence[NextTest]) -> list[str]:
    """One line for each measurement, however many pairs it tells apart."""
    pairs: dict[str, list[str]] = {}
    for test in tests:
        pairs.setdefault(test.measure or "a channel that is not logged yet", []).append(
            f"{words.plain(test.separates[0])} from {words.plain(test.separates[1])}")
    return [svg.element("li", svg.element("strong", svg.text(measure[:1].upper() + measure[1:])),
                        svg.text(f": tells {words.listed(list(dict.fromkeys(told)), 'and')}."))
            for measure, told in pairs.items()]


def _nothing_to_test(verdict: str) -> str:
    return {
        "no_gap": "No test is needed: there is no gap to explain.",
        "cause_found": "No test is needed to name the cause. To confirm the promise, measure fresh "
                       "points and diagnose again with them as holdout.",
        "unexplained": "No test between listed effects helps while none of them explains the gap. "
                       "Repeat the points in the places marked on the map and measure more points "
                       "there, closer together.",
    }.get(verdict, "No further test is known that would tell the remaining causes apart.")


def watts(rows: Sequence[tuple[str, float, float]], added: bool) -> str:
    """Return mean watts by part, before and after."""
    if not added:
        return table(("part", "power lost [W]"),
                     [(part, words.fixed(before, 0)) for part, before, _ in rows])
    return table(("part", "before [W]", "after [W]", "change [W]"),
                 [(part, words.fixed(before, 0), words.fixed(after, 0),
                   words.fixed(after - before, 0, sign=True)) for part, before, after in rows])


def provenance(found: Diagnosis) -> str:
    """Return what was diagnosed with what, so that it can be found again."""
    samples, gap = found.samples, found.gap
    channels = [name for name in ("output_speed", "oil_temperature", "efficiency_std")
                if getattr(samples, name) is not None]
    facts = [
        ("Bench data", samples.source.rsplit("/", 1)[-1]),
        ("SHA-256 of the file", samples.sha256 or "not read from a file"),
        ("Samples", str(len(samples))),
        ("Further channels used", words.listed([words.plain(name) for name in channels], "and")
         or "none"),
        ("Noise of the efficiency", f"{words.points(gap.noise)} found, "
         f"{words.points(gap.noise_stated)} stated ({gap.noise_source})"),
        ("Shrinkage measured on", found.shrinkage.on),
        ("Base model", f"formulation {found.base.formulation}, fingerprint "
         f"{found.base.fingerprint}"),
    ]
    if found.model is not found.base:
        facts.append(("Model with the effect", f"fingerprint {found.model.fingerprint}"))
    listing = svg.element("dl", *(
        svg.element("dt", svg.text(term)) + svg.element("dd", svg.text(value), class_="code")
        for term, value in facts))
    return listing + _parameters(found)


def _parameters(found: Diagnosis) -> str:
    added = found.model is not found.base
    rows = []
    for name, unit in PARAMETER_UNITS.items():
        values = [getattr(model.parameters, name) for model in
                  ((found.base, found.model) if added else (found.base,))]
        rows.append((words.plain(name), words.unit(unit), *map(words.number, values)))
    head = ("base parameter, refitted", "unit", "without effect", "with effect")
    return table(head[: 4 if added else 3], rows, text_columns=2)
