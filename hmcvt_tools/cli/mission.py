# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt mission`: the fuel of a work cycle."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from hmcvt_core.errors import HmcvtError, InputError
from hmcvt_core.files import data_path
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.files.table import csv_text
from hmcvt_core.model.engine import load_engine
from hmcvt_core.model.parameter_file import load_model

from ..mission import STRATEGIES, Drive, Mission, Planned, load_vehicle, read_cycle
from ..mission.cycle import STEP
from ..report.mission import (
    draw_flow,
    draw_mission,
    draw_strategies,
    write_mission_page,
)
from ..report.pictures import save
from ..report.style import report_format
from . import common
from .common import Answer

PICTURES: dict[str, Callable[..., None]] = {
    "course": draw_mission,
    "flow": draw_flow,
    "strategies": draw_strategies,
}


def _page_format(path: str) -> str:
    ending = report_format(path)
    if ending != ".html":
        raise InputError(f"{path}: the report of a mission ends in .html")
    return ending


@common.command(
    "mission",
    """
  hmcvt mission ploughing --bound
  hmcvt mission my_cycle.csv --params params/tractor.yaml --engine params/engine.yaml --json
  hmcvt mission transport --strategy engine_line --compare --report mission.html
  hmcvt mission my_cycle.csv --strategy my_strategy.py --out series.csv --picture course.png""",
    common.picture_option,
    common.effects_option,
)
@click.argument("cycle", metavar="CYCLE.csv")
@click.option(
    "--params",
    metavar="T.yaml",
    help="Parameter file of the transmission.  [default: the shipped params/tractor.yaml]",
)
@click.option(
    "--engine",
    metavar="E.yaml",
    help="Full-load curve and fuel map.  [default: the shipped params/engine.yaml]",
)
@click.option(
    "--vehicle",
    metavar="V.yaml",
    help="Tyres, masses and limits of the machine.  [default: the shipped "
    "params/vehicle.yaml]",
)
@click.option(
    "--strategy",
    metavar="NAME|FILE.py",
    default="causal",
    show_default=True,
    help=f"{', '.join(STRATEGIES)}, or a Python file with choose(now), which is run.",
)
@click.option("--bound", is_flag=True, help="Find the least fuel possible, too.")
@click.option(
    "--compare", is_flag=True, help="Drive the cycle with every shipped strategy, too."
)
@click.option(
    "--step",
    type=float,
    default=STEP,
    show_default=True,
    help="Length of a step [s]; a finer file is averaged.",
)
@click.option(
    "--out",
    type=common.OutputFile(),
    metavar="SERIES.csv",
    help="Write the course, one row a step.",
)
@click.option(
    "--report",
    type=common.OutputFile(_page_format),
    metavar="R.html",
    help="Write the page, with all strategies and the bound.",
)
@click.option(
    "--shows",
    type=click.Choice(list(PICTURES)),
    default="course",
    show_default=True,
    help="What --picture draws.",
)
def command(
    cycle: str,
    params: str | None,
    engine: str | None,
    vehicle: str | None,
    strategy: str,
    bound: bool,
    compare: bool,
    step: float,
    out: str | None,
    report: str | None,
    shows: str,
    picture: str | None,
) -> Answer:
    """Find the fuel of a work cycle, and how close to the best a strategy comes.

    CYCLE.csv holds the demand over time, or is the name of a shipped cycle: ploughing,
    rotary_tilling, transport, sowing, loader.
    """
    inputs = [cycle, params, engine, vehicle, strategy]
    common.keep_inputs(inputs, [out, report, picture])
    drive = Drive(
        load_model(params or data_path("params/tractor.yaml")),
        load_engine(engine or data_path("params/engine.yaml")),
        load_vehicle(vehicle or data_path("params/vehicle.yaml")),
    )
    demand = read_cycle(cycle, drive.vehicle, step)
    common.note_oil_temperature(drive.model)
    planned = Planned.of(drive, demand, with_bound=bound or report is not None)
    mission = planned.mission(strategy)
    if not mission.driven:
        raise HmcvtError(
            f"{demand.name}: no step can be driven; {mission.unmet[0].time:g} s: "
            f"{mission.unmet[0].reason}"
        )
    missions = [mission]
    if compare or report is not None or shows == "strategies":
        missions += _others(planned, strategy)
    return _answer(missions, out, report, picture, shows)


def _others(planned: Planned, strategy: str) -> list[Mission]:
    missions = []
    for name in STRATEGIES:
        if name != strategy:
            missions.append(planned.mission(name))
    return missions


def _answer(
    missions: list[Mission],
    out: str | None,
    report: str | None,
    picture: str | None,
    shows: str,
) -> Answer:
    """Write the files asked for and return the answer."""
    mission = missions[0]
    lines = [mission.report()]
    value: dict[str, Any] = mission.to_dict()
    if len(missions) > 1:
        value["strategies"] = {other.strategy: _brief(other) for other in missions}
        lines.append(_comparison(missions))
    if out is not None:
        write_atomically(Path(out), csv_text(_cells(mission)))
        lines.append(f"series written to {out}")
    if picture is not None:
        shown = missions if shows == "strategies" else mission
        save(PICTURES[shows], picture, shown)
        lines.append(f"picture written to {picture}")
    if report is not None:
        write_mission_page(missions, report)
        lines.append(f"page written to {report}")
    return Answer(value, lines)


def _brief(mission: Mission) -> dict[str, Any]:
    return {
        "fuel": mission.fuel,
        "above_bound": mission.above_bound,
        "shifts": mission.shifts,
        "broken": len(mission.broken),
    }


def _comparison(missions: list[Mission]) -> str:
    rows = []
    for mission in missions:
        above = "-"
        if mission.above_bound is not None:
            above = f"{round(100.0 * mission.above_bound, 2) + 0.0:.2f}"
        rows.append(
            (
                mission.strategy,
                f"{mission.fuel:.3f}",
                above,
                str(mission.shifts),
                str(len(mission.broken)),
            )
        )
    head = ("strategy", "kg", "% above bound", "stage changes", "limits broken")
    return common.table(head, rows)


def _cells(mission: Mission) -> dict[str, list[str]]:
    """Return the course as cells; empty where a number is not known."""
    columns = {}
    for name, values in mission.series().items():
        cells = []
        for value in values:
            if isinstance(value, str):
                cells.append(value)
            else:
                cells.append("" if value != value else f"{value:.6g}")
        columns[name] = cells
    return columns
