# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.export`: exported code against Python, compilers, a Cortex-M4 and tests."""

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import click

import hmcvt_core as hmcvt
import hmcvt_tools
from hmcvt_core.files.atomic import write_atomically
from hmcvt_tools.export.effect_tables import BOUND
from studies.page import Goal, goal_table, machine, render, table

from .answers import (
    EffectFigures,
    StageFigures,
    all_effect_figures,
    exported_models,
    stage_figures,
)
from .programs import (
    CortexFigures,
    SelfTests,
    TestFigures,
    cortex_figures,
    fmu_tool_verdicts,
    self_tests,
    test_figures,
    versions,
)

SINGLE_ERROR = 1e-4
OPTIMUM_ERROR = 1e-6
LARGEST_CODE = 16 * 1024


@click.command("export")
@click.option("--points", type=click.IntRange(1000), default=1_000_000)
@click.option("--demands", type=click.IntRange(10), default=10_000)
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), default=None)
def command(points: int, demands: int, out: Path | None) -> None:
    """Measure exported code; return 1 where a goal is missed."""
    began = time.monotonic()
    with TemporaryDirectory() as name:
        folder = Path(name)
        stages = _stages(folder, points, demands)
        effects = all_effect_figures(100_000)
        click.echo(_effect_table(effects))
        folders = sorted(path for path in folder.iterdir() if path.is_dir())
        builds = self_tests(folders)
        click.echo(_build_table(builds))
        cortex = cortex_figures(folders)
        click.echo(_cortex_table(cortex))
        verdicts = fmu_tool_verdicts(_fmus(folder))
        tests = test_figures(folder)
    goals = _goals(stages, effects, builds, cortex, tests)
    click.echo(goal_table(goals))
    if out is not None:
        page = render(
            "page.md.j2",
            Path(__file__).parent,
            points=points,
            demands=demands,
            minutes=round((time.monotonic() - began) / 60.0),
            machine=machine(),
            versions=versions(),
            goals=goal_table(goals),
            stages=_stage_table(stages),
            effects=_effect_table(effects),
            builds=_build_table(builds),
            cortex=_cortex_table(cortex),
            verdicts=verdicts,
            tests=tests,
        )
        write_atomically(out, page)
    if not all(goal.met for goal in goals):
        sys.exit(1)


def _stages(folder: Path, points: int, demands: int) -> list[StageFigures]:
    figures = []
    for exported in exported_models(folder):
        for stage in exported.model.stages:
            figures.append(stage_figures(exported, stage, points, demands))
            click.echo(figures[-1])
    return figures


def _fmus(folder: Path) -> list[Path]:
    model = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    paths = []
    for version in (2, 3):
        path = folder / f"fmi{version}.fmu"
        hmcvt_tools.export_fmu(model, path, version)
        paths.append(path)
    return paths


def _goals(
    stages: list[StageFigures],
    effects: list[EffectFigures],
    builds: list[SelfTests],
    cortex: list[CortexFigures],
    tests: TestFigures,
) -> list[Goal]:
    """Return what was aimed at and what was reached."""
    bits = sum(stage.differing_bits for stage in stages)
    single = max(stage.single_error for stage in stages)
    single_status = sum(stage.single_status for stage in stages)
    optimum = max(max(stage.stroke_error, stage.speed_error) for stage in stages)
    alone = sum(stage.optimum_status for stage in stages)
    bound = max(case.error for case in effects)
    passed = sum(row.passed for row in builds)
    run = sum(row.run for row in builds)
    goals = [
        Goal(
            "double precision: answers that differ from Python's",
            "0",
            f"{bits}",
            bits == 0,
        ),
        Goal(
            "single precision: largest error of the efficiency",
            f"{SINGLE_ERROR:g}",
            f"{single:.1e}",
            single <= SINGLE_ERROR,
        ),
        Goal(
            "single precision: points answered in C or Python only",
            "0",
            f"{single_status}",
            single_status == 0,
        ),
        Goal(
            "optimum: largest error of the efficiency",
            f"{OPTIMUM_ERROR:g}",
            f"{optimum:.1e}",
            optimum <= OPTIMUM_ERROR,
        ),
        Goal(
            "optimum: demands answered in C or Python only", "0", f"{alone}", alone == 0
        ),
        Goal(
            "effects: error of the efficiency at 99 % of fresh points",
            f"{BOUND:g}",
            f"{bound:.1e}",
            bound <= BOUND,
        ),
        Goal("self-tests that pass", f"{run}", f"{passed}", passed == run),
    ]
    if cortex:
        largest = max(row.code for row in cortex)
        agree = sum("answers agree" in row.self_test for row in cortex)
        goals += [
            Goal(
                "Cortex-M4: self-tests that pass",
                f"{len(cortex)}",
                f"{agree}",
                agree == len(cortex),
            ),
            Goal(
                "Cortex-M4: code and constants [bytes]",
                f"{LARGEST_CODE}",
                f"{largest}",
                largest <= LARGEST_CODE,
            ),
        ]
    goals.append(Goal("tests that fail", "0", f"{tests.failed}", tests.failed == 0))
    return goals


def _stage_table(stages: list[StageFigures]) -> str:
    head = (
        "file and stage",
        "double: answers that differ",
        "single: largest error",
        "single: in one only",
        "best stroke: largest error",
        "best engine speed: largest error",
        "ns a point",
    )
    rows = []
    for stage in stages:
        rows.append(
            (
                stage.name,
                stage.differing_bits,
                f"{stage.single_error:.1e}",
                stage.single_status,
                f"{stage.stroke_error:.0e}",
                f"{stage.speed_error:.0e}",
                f"{stage.nanoseconds:.0f}",
            )
        )
    return table(head, rows)


def _effect_table(effects: list[EffectFigures]) -> str:
    head = ("model", "99 % of points", "largest", "in one only", "tables")
    rows = []
    for case in effects:
        rows.append(
            (
                case.name,
                f"{case.error:.1e}",
                f"{case.largest:.1e}",
                f"{100.0 * case.differing:.3f} %",
                f"{case.kilobytes:.0f} KB",
            )
        )
    return table(head, rows)


def _build_table(builds: list[SelfTests]) -> str:
    rows = [(row.compiler, row.flags, f"{row.passed} of {row.run}") for row in builds]
    return table(("compiler", "flags", "self-tests that pass"), rows)


def _cortex_table(cortex: list[CortexFigures]) -> str:
    head = (
        "export",
        "code and constants [bytes]",
        "variables [bytes]",
        "instructions a point",
        "best stroke",
        "best engine speed",
    )
    rows = []
    for row in cortex:
        rows.append(
            (row.folder, row.code, row.data, row.predict, row.stroke, row.speed)
        )
    return table(head, rows)


if __name__ == "__main__":
    command()
