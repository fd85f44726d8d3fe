# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Figures and tables of the page: where the gap lies, residuals and watts before and after."""

import itertools
from functools import partial
from operator import methodcaller
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..diagnosis import Diagnosis
from ..diagnosis.results import text as words
from ..diagnosis.settings import REGION_SIGNIFICANCE
from ..diagnosis.system import Axis
from ..transmission.ranges import RPM, Array
from .pictures import lost_power, scale, stack, worth_drawing
from .style import BLUE, INK, ORANGE, few_ticks, icon, loss_style, styled, to_svg

Rows = NDArray[np.intp]
Figures = tuple[list[str], list[tuple[str, str]]]
"""Drawings side by side (SVG), and their legend: text, and SVG of a mark."""

# Label, factor to what is shown, decimals and words, for each axis of the working space.
_AXES = {
    "displacement_ratio": ("displacement ratio [-]", 1.0, 2, "displacement ratio {}"),
    "engine_speed": ("engine speed [r/min]", 1.0 / RPM, 0, "{} r/min"),
    "load_torque": ("load torque [N·m]", 1.0, 0, "{} N·m"),
    "speed": ("speed [r/min]", 1.0 / RPM, 0, "{} r/min"),
    "pressure": ("pressure [bar]", 1e-5, 0, "{} bar"),
}
_MAP = (6.9, 6.0)  # in
MOST = 300
"""Marks and rows, the same ones; of more samples an even part is shown."""
_SMALL, _LARGE, _DOT, _USUAL = 6.5, 19.5, 5.0, 14.0  # height of a mark [pt]
_MARKS = {  # marker, fill, edge
    "below": ("v", ORANGE, "w"),
    "above": ("^", BLUE, "w"),
    "within": ("o", "#9aa3ad", "none"),
    "place": ("s", "none", INK),
}
_WHOLE = 0.86  # part of a view from which a place spans it and says nothing
_ROOM, _FLAG = 0.025, 0.033  # around a place; half a flag; parts of a view
_OUTWARDS = np.array([[-1.0], [1.0]])
# Where a flag may stand along the edge of a place, from 0 to 1: the corners first.
_EDGE = np.array(
    sorted(
        (
            at
            for at in itertools.product(np.linspace(0.0, 1.0, 9), repeat=2)
            if {0.0, 1.0} & {*at}
        ),
        key=lambda at: len({*at} - {0.0, 1.0}),
    )
)
_TREND_SAMPLES, _TREND_BINS = 24, 8


def _axis(axis: Axis) -> tuple[str, float, int, str]:
    """Label, factor to what is shown, decimals and words of an axis; its own where none are set."""
    if axis.name in _AXES:
        return _AXES[axis.name]
    unit = "" if axis.unit == "-" else f" {axis.unit}"
    words = f"{axis.word} {{}}{unit}"
    return f"{axis.word} [{axis.unit}]", 1.0, axis.digits, words


def _shown(samples: Any, axis: Axis) -> Array:
    return np.asarray(getattr(samples, axis.name)) * _axis(axis)[1]


def _names(found: Diagnosis, samples: Any) -> list[str]:
    """What each test is called: by its row in the file, if it was read from one."""
    kind = "" if samples is found.samples else "held-out "
    return (
        [f"{kind}row {row}" for row in samples.rows]
        if getattr(samples, "rows", ())
        else [f"{kind}test {i}" for i in range(1, len(samples) + 1)]
    )


def columns(found: Diagnosis) -> list[tuple[str, str, float, int]]:
    """Heading, axis, factor and decimals of each column that tells a place; speeds twice."""
    told = []
    for axis in found.axes:
        label, factor, digits, _ = _axis(axis)
        told.append((label, axis.name, factor, digits))
        if label.endswith("[r/min]"):
            told.append((label.replace("r/min", "rad/s"), axis.name, 1.0, 1))
    return told


def _in_words(found: Diagnosis, samples: Any, values: Array, chosen: Rows) -> list[str]:
    """Each of the chosen samples and its residual."""
    names = _names(found, samples)
    axes = [(_axis(axis), _shown(samples, axis)) for axis in found.axes]
    return [
        f"{names[i]}: "
        + ", ".join(
            form.format(words.fixed(row[i], digits))
            for (_, _, digits, form), row in axes
        )
        + f": {words.amount(found, values[i], sign=True)}"
        for i in chosen
    ]


def _picked(values: Array) -> Rows:
    """Which samples are drawn: those that have a residual, or an even part of them."""
    known = np.flatnonzero(np.isfinite(values))
    return known[:: max(1, -(-len(known) // MOST))]


def gap_map(found: Diagnosis) -> Figures:
    """Draw the residuals of the refitted base model at the samples diagnosed, view by view."""
    values, twice = found.residuals, 2.0 * found.gap.noise
    largest = float(np.nanmax(np.abs(values), initial=twice))
    entries = [
        ("bench below model", "below", _USUAL),
        ("bench above model", "above", _USUAL),
        (f"within twice the noise ({words.amount(found, twice)})", "within", _DOT),
        (
            f"this size: {words.amount(found, largest / 2.0)}",
            "below",
            (_SMALL + _LARGE) / 2.0,
        ),
    ]
    if found.where:
        entries.append(("numbered places of the table below", "place", _USUAL))
    legend = [
        (
            text,
            icon(
                f"mark-{i}",
                partial(_scatter, kind=kind, at=[[0.5, 0.5]], height=height),
            ),
        )
        for i, (text, kind, height) in enumerate(entries)
    ]
    # Large marks first, so that small ones stay visible.
    shown = _picked(values)
    shown = shown[np.argsort(-np.abs(values[shown]), kind="stable")]
    size = np.abs(values[shown])
    height = np.where(
        size <= twice,
        _DOT,
        _SMALL + (_LARGE - _SMALL) * np.minimum(size / largest, 1.0),
    )
    kinds = np.select(
        [size <= twice, values[shown] < 0.0], ["within", "below"], "above"
    )
    marks = {
        kind: (shown[kinds == kind], height[kinds == kind])
        for kind in _MARKS
        if kind in kinds
    }
    tips = {
        kind: _in_words(found, found.samples, values, at)
        for kind, (at, _) in marks.items()
    }
    views = []
    for across, up in itertools.combinations(found.axes, 2):
        at = np.column_stack([_shown(found.samples, across), _shown(found.samples, up)])
        with styled(_MAP) as figure:
            axes = figure.subplots()
            axes.update_datalim(
                at
            )  # of all samples, whether they have a residual or not
            axes.margins(0.07)
            axes.autoscale_view()
            axes.set(
                xlim=axes.get_xlim(),
                ylim=axes.get_ylim(),
                xlabel=_axis(across)[0],
                ylabel=_axis(up)[0],
            )
            few_ticks(axes)
            for kind, (rows, heights) in marks.items():
                _scatter(axes, kind, at[rows], heights)
            _outline(axes, found, (across, up), at[shown])
            views.append(
                to_svg(
                    figure,
                    f"map-{across.name}-{up.name}".replace("_", "-"),
                    f"Map of residuals: {_axis(up)[0]} over {_axis(across)[0]}; "
                    "triangles down where the bench lies below the model, up where above",
                    tips,
                )
            )
    return views, legend


def _scatter(axes: Any, kind: str, at: Any, height: Any) -> None:
    marker, fill, edge = _MARKS[kind]
    axes.scatter(
        *np.transpose(at),
        s=np.square(height),
        marker=marker,
        facecolors=fill,
        edgecolors=edge,
        linewidths=2.0 if kind == "place" else 0.8,
        gid=kind,
        clip_on=False,
    )


def _outline(
    axes: Any, found: Diagnosis, view: tuple[Axis, Axis], marks: Array
) -> None:
    """Outline the places that do not span the whole view, each with its number beside the marks."""
    low, high = np.column_stack([axes.get_xlim(), axes.get_ylim()])
    taken = (marks - low) / (high - low)
    for number, region in enumerate(found.where, 1):
        ends = np.transpose(
            [np.multiply(region.limits[axis.name], _axis(axis)[1]) for axis in view]
        )
        box = (ends - low) / (high - low)
        if np.all(box[1] - box[0] > _WHOLE):
            continue
        # A mark at the edge belongs to the place.
        (left, bottom), (right, top) = box = np.clip(
            box + _OUTWARDS * _ROOM, 0.004, 0.996
        )
        axes.plot(
            (left, right, right, left, left),
            (bottom, bottom, top, top, bottom),
            color=INK,
            lw=2.0,
            ls="-" if region.p_value <= REGION_SIGNIFICANCE else (0, (3, 2)),
            transform=axes.transAxes,
        )
        at = _free(box, taken)
        taken = np.vstack([taken, at])
        axes.text(
            *at,
            str(number),
            transform=axes.transAxes,
            ha="center",
            va="center",
            color="w",
            weight="bold",
            bbox={"boxstyle": "square,pad=0.25", "fc": INK},
        )


def _free(box: Array, taken: Array) -> Array:
    """Where a flag is clear of what is taken: inside a box, else beside it, a corner if it may."""
    flags = np.vstack(
        [
            np.clip(low + _EDGE * (high - low), _FLAG, 1.0 - _FLAG)
            for low, high in (box - _OUTWARDS * _FLAG, box + _OUTWARDS * _FLAG)
        ]
    )
    clear = (
        np.abs(flags[:, None] - taken).max(axis=-1).min(axis=-1, initial=2.0 * _FLAG)
    )
    return np.asarray(flags[clear.argmax()])


def _panels(found: Diagnosis) -> tuple[dict[str, Array], float]:
    """Residuals before and after by title, and how far the axis reaches."""
    panels = {"Base model, refitted": found.residuals_before}
    if found.verdict != "no_gap":
        panels[
            "Best listed effect added"
            if found.verdict == "unexplained"
            else "With the effect added"
        ] = found.residuals_after
    largest = np.nanmax(np.abs(list(panels.values())), initial=2.5 * found.gap.noise)
    return panels, 1.1 * float(largest)


def residuals(found: Diagnosis) -> Figures:
    """Draw the residuals at samples left out (or of the holdout) before and after."""
    label, _ = _across(found)
    panels, reach = _panels(found)
    drawings = []
    for i, (title, values) in enumerate(panels.items()):
        with styled() as figure:
            _panel(figure.subplots(), found, title, values, reach)
            drawings.append(
                to_svg(
                    figure,
                    f"residuals-{i}",
                    f"{title}: measured minus predicted "
                    f"{words.plain(found.channel.name)} over {label}",
                    {"sample": _in_words(found, found.judged, values, _picked(values))},
                )
            )
    return drawings, []


def residual_table(found: Diagnosis) -> dict[str, Any]:
    """The residuals as a table: its head and its rows of text."""
    samples, panels, channel = found.judged, _panels(found)[0], found.channel
    shown, names = (
        slice(None, None, max(1, -(-len(samples) // MOST))),
        _names(found, samples),
    )
    unit = "%" if channel.unit == "points" else channel.unit
    told = [
        (_axis(axis)[0], _shown(samples, axis), _axis(axis)[2] + 1)
        for axis in found.axes
    ]
    told += [
        (f"{title} [{of}]", channel.factor * values, 2)
        for title, of, values in (
            ("measured", unit, getattr(samples, channel.name)),
            *((title, channel.unit, values) for title, values in panels.items()),
        )
    ]
    rows = [
        names,
        *(
            [words.fixed(value, digits) for value in values]
            for _, values, digits in told
        ),
    ]
    return {
        "head": ("test", *(label for label, _, _ in told)),
        "rows": list(zip(*(row[shown] for row in rows), strict=True)),
    }


def place_rows(found: Diagnosis) -> list[tuple[Any, ...]]:
    """Rows of the places at which the bench differs from the model."""
    return [
        (
            number,
            words.amount(found, region.mean_residual, sign=True),
            *(
                " to ".join(
                    words.fixed(factor * end, digits) for end in region.limits[axis]
                )
                for _, axis, factor, digits in columns(found)
            ),
            region.samples,
            words.chance(region.p_value)
            + " (may be chance)" * (region.p_value > REGION_SIGNIFICANCE),
            words.plain(region.channel),
        )
        for number, region in enumerate(found.where, 1)
    ]


def test_rows(found: Diagnosis) -> list[tuple[Any, ...]]:
    """Rows of the operating points to measure next."""
    tests = ((test, test.point) for test in found.next_tests if test.point is not None)
    return [
        (
            number,
            " | ".join(map(words.plain, test.separates)),
            *(
                words.fixed(factor * point[axis], digits)
                for _, axis, factor, digits in columns(found)
            ),
            words.number(test.gain),
            words.plain(test.measure or words.NOTHING),
        )
        for number, (test, point) in enumerate(tests, 1)
    ]


def draw_residuals(figure: Any, found: Diagnosis, ax: Any = None) -> None:
    """Draw the residuals before and after on an empty matplotlib figure, or the last into axes."""
    panels, reach = _panels(found)
    if ax is not None:
        title, values = list(panels.items())[-1]
        _panel(ax, found, title, values, reach)
        return
    for axes, (title, values) in zip(
        figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True
    ):
        _panel(axes, found, title, values, reach)


def _across(found: Diagnosis) -> tuple[str, Array]:
    """Label and values of the axis along which the first place is narrowest."""

    def width(axis: Axis) -> float:
        span = np.ptp(getattr(found.samples, axis.name))
        return float(np.ptp(found.where[0].limits[axis.name]) / max(span, 1e-12))

    speeds = [axis for axis in found.axes if axis.name.endswith("speed")]
    axis = speeds[0] if speeds else found.axes[0]
    if found.where:
        axis = min(found.axes, key=width)
    return _axis(axis)[0], _shown(found.judged, axis)


def _panel(
    axes: Any, found: Diagnosis, title: str, values: Array, reach: float
) -> None:
    label, across = _across(found)
    known, shown = np.flatnonzero(np.isfinite(values)), _picked(values)
    rms = (
        f"{words.amount(found, np.sqrt(np.mean(values[known] ** 2)))} rms"
        if len(known)
        else "not known"
    )
    factor = found.channel.factor
    reach, noise = factor * reach, factor * found.gap.noise
    axes.axhspan(-2.0 * noise, 2.0 * noise, color="#e9edf1", lw=0.0)
    axes.axhline(0.0, color="0.4", lw=1.0)
    axes.scatter(
        across[shown],
        factor * values[shown],
        s=40.0,
        color=BLUE,
        alpha=0.75,
        edgecolors="w",
        linewidths=0.6,
        gid="sample",
    )
    if len(known) >= _TREND_SAMPLES:
        parts = np.array_split(
            known[np.argsort(across[known], kind="stable")], _TREND_BINS
        )
        axes.plot(
            [across[part].mean() for part in parts],
            [factor * values[part].mean() for part in parts],
            color="k",
            lw=2.4,
        )
    axes.update_datalim(np.column_stack([across, across]))  # one range before and after
    axes.autoscale_view()
    axes.set(
        ylim=(-reach, reach),
        xlabel=label,
        title=f"{title}: {rms}",
        ylabel=f"measured minus predicted [{found.channel.unit}]",
    )
    few_ticks(axes)


def watts(found: Diagnosis) -> dict[str, Any]:
    """Where the watts go at the median speed and load, before and after the effect is added.

    Returns:
        The `figures`; engine `speed` [rad/s] and `load` [N m]; `means`: part, mean watts before
        and after over the points that both models answer, NaN if there is none, the total last;
        `shares`: whether every effect added takes watts of its own.
    """
    base, model, samples = found.base, found.model, found.samples
    speed, load = (
        float(np.median(samples.engine_speed)),
        float(np.median(samples.load_torque)),
    )
    heat = (
        None
        if samples.oil_temperature is None
        else float(np.median(samples.oil_temperature))
    )
    before = lost_power(base, speed, load, heat)
    after = before if model is base else lost_power(model, speed, load, heat)
    parts, totals = (
        worth_drawing(before, after),
        [sum(each.values()) for each in (before, after)],
    )
    answered = np.isfinite(sum(totals))

    def mean(loss: Any) -> float:
        known = np.broadcast_to(loss, answered.shape)[answered]
        return float(known.mean()) if len(known) else float("nan")

    means = [
        *(
            (part, mean(before.get(part, 0.0)), mean(after.get(part, 0.0)))
            for part in parts
        ),
        ("total", *map(mean, totals)),
    ]
    panels = {"Base model, refitted": before}
    if after is not before:
        panels["With the effect added"] = after
    drawings, (low, high) = [], scale(before, after)
    for index, (title, balance) in enumerate(panels.items()):
        kilowatts = {part: lost / 1e3 for part, lost in balance.items()}
        with styled() as figure:
            axes = figure.subplots()
            stack(axes, kilowatts, parts)
            axes.set(
                title=title, ylabel="power lost [kW]", ylim=(low / 1e3, high / 1e3)
            )
            few_ticks(axes)
            tips = {
                part: f"{part}: {words.fixed(np.nanmin(lost), 2)} to "
                f"{words.fixed(np.nanmax(lost), 2)} kW"
                for part, lost in kilowatts.items()
                if np.any(np.isfinite(lost))
            }
            drawings.append(
                to_svg(
                    figure,
                    f"watts-{index}",
                    f"{title}: power lost in each part over displacement ratio",
                    tips,
                )
            )
    legend = [
        (
            part,
            icon(
                f"part-{i}",
                methodcaller(
                    "fill_between", (0.05, 0.95), 0.05, 0.95, **loss_style(part)
                ),
            ),
        )
        for i, part in enumerate(parts)
    ]
    return {
        "figures": (drawings, legend[::-1]),
        "means": means,
        "speed": speed,
        "load": load,
        "rpm": RPM,
        "shares": after is before or bool(after.keys() - before.keys()),
    }
