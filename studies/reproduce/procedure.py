# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Runs everything and gathers the items and what the figures are drawn from."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from hmcvt_tools.fleet.executors import Processes

from . import (
    algorithms,
    comparison,
    conclusions,
    formulas,
    intervals,
    paper,
    subsets,
    surfaces,
    tables,
)
from .comparison import Summary
from .conclusions import Enumeration
from .item import Item
from .surfaces import Surface
from .tables import Fit

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Everything that was found.

    Attributes:
        items: every comparison, in the order of the report.
        fits: by formulation and gear efficiency.
        surfaces: figures 3 to 5.
        summaries: figure 6 and the ablation, by algorithm.
        lowest: lowest 1 - RSQ known of the paper's identification.
        enumerations: Table 3 under every kind of fit.
        seeds: of each algorithm.
    """

    items: tuple[Item, ...]
    fits: dict[tuple[str, float], Fit]
    surfaces: tuple[Surface, ...]
    summaries: dict[str, Summary]
    lowest: float
    enumerations: tuple[Enumeration, ...]
    seeds: int


def reproduce(
    seeds: int, jobs: int = 1, progress: Callable[[str], None] | None = None
) -> Reproduction:
    """Compare every number and figure of the paper with ours.

    Args:
        seeds: runs of each algorithm of figure 6.
        jobs: processes side by side; they do not change the results, times apart.
        progress: called with a line of text after each piece of work.
    """
    tell = progress or (lambda text: None)
    with Processes(jobs) as pool:

        def done(
            work: Callable[[Task], Result], tasks: Sequence[Task], what: str
        ) -> list[Result]:
            found = []
            for result in pool.map(work, tasks):
                found.append(result)
                tell(f"{what}, {len(found)} of {len(tasks)}")
            return found

        fits = dict(
            zip(
                tables.fit_tasks(),
                done(tables.fit, tables.fit_tasks(), "identification"),
                strict=True,
            )
        )
        lowest = fits["published", paper.BEST_GEAR_EFFICIENCY].identification.objective
        tried = conclusions.enumerations(
            done(conclusions.fit, conclusions.tasks(), "gear efficiency")
        )
        subset_fits = done(subsets.fit, subsets.tasks(), "subset of the tests")
        determined = done(
            intervals.interval, intervals.TASKS, "interval of a parameter"
        )
        runs = done(algorithms.run, comparison.tasks(seeds, lowest), "run of figure 6")
    tell("gathering")
    drawn = surfaces.surfaces(fits)
    summaries = comparison.summaries(runs, lowest)
    items = [
        *formulas.uncertainties(),
        *formulas.items(),
        *tables.items(fits),
        *conclusions.items(fits),
        *subsets.items(subset_fits),
        *conclusions.gear_items(fits, tried),
        *surfaces.items(drawn),
        *comparison.items(summaries),
        *determined,
        *map(intervals.tie, intervals.SETS),
    ]
    groups = list(dict.fromkeys(item.group for item in items))
    items.sort(key=lambda item: groups.index(item.group))
    return Reproduction(
        tuple(items), fits, tuple(drawn), summaries, lowest, tuple(tried), seeds
    )
