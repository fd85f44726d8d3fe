# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt export`."""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import click

from hmcvt_core.model.model import EfficiencyModel

from ..export import export_c, export_fmu, export_mat
from ..export.c_model import PRECISIONS
from ..export.effect_tables import BOUND
from . import common
from .common import Answer

FORMATS = ("c", "fmu", "mat")

# For every command that exports; None where left out, which means `BOUND`.
bound_option = click.option(
    "--bound",
    type=common.fraction,
    metavar="ERROR",
    help="Of a model with effects: error of the efficiency that their tables may make, 0.002 "
    "or 0.2% for 0.2 points.  [default: 0.2%]",
)


@common.command(
    "export",
    """
  hmcvt export --params params/tractor.yaml --format c --out controller
  hmcvt export --params params/tractor.yaml --format c --out ecu --stage HM3 HM4 --precision single
  hmcvt export --params params/tractor.yaml --format fmu --fmi 3 --out tractor.fmu
  hmcvt export --params params/hm4.yaml --format mat --out hm4.mat""",
    common.params_option,
)
@click.option(
    "--format",
    "kind",
    type=click.Choice(FORMATS),
    required=True,
    help="C99 for a controller, an FMU for a simulator, or maps for MATLAB (.mat or .m).",
)
@click.option(
    "--out",
    required=True,
    metavar="DIR|FILE",
    help="Folder of the C code, which does not exist yet; or file to write.",
)
@click.option(
    "--stage",
    "stages",
    multiple=True,
    metavar="NAME ...",
    help="Stages to export; all when left out.",
)
@click.argument("more_stages", nargs=-1, metavar="")
@click.option(
    "--precision",
    type=click.Choice(PRECISIONS),
    help="Of the C code.  [default: double]",
)
@click.option(
    "--fmi",
    type=click.Choice(("2", "3")),
    help="Version of the standard that the FMU follows.  [default: 2]",
)
@bound_option
def command(
    params: str | None,
    kind: str,
    out: str,
    stages: tuple[str, ...],
    more_stages: tuple[str, ...],
    precision: str | None,
    fmi: str | None,
    bound: float | None,
) -> Answer:
    """Write the model for use without Python: C code, an FMU, or maps for MATLAB."""
    if more_stages and not stages:
        raise click.UsageError(
            f"{more_stages[0]}: write --stage before names of stages"
        )
    if precision is not None and kind != "c":
        raise click.UsageError("--precision is of the format c")
    if fmi is not None and kind != "fmu":
        raise click.UsageError("--fmi is of the format fmu")
    if bound is not None and kind == "mat":
        raise click.UsageError("--bound is of the formats c and fmu")
    common.keep_inputs([params], [out])
    model = common.model_from(params)
    names = (*stages, *more_stages)
    if names:
        model = _with_stages(model, names)
    accuracy = None
    error = BOUND if bound is None else bound
    if kind == "c":
        accuracy = export_c(model, out, precision or "double", error)
    elif kind == "fmu":
        accuracy = export_fmu(model, out, int(fmi or "2"), error)
    else:
        export_mat(model, out)
    value = {
        "format": kind,
        "path": str(Path(out)),
        "fingerprint": model.fingerprint,
        "stages": list(model.stages),
        "effects": None if accuracy is None else accuracy._asdict(),
    }
    lines = [f"model {model.fingerprint} written to {out}"]
    if accuracy is not None:
        lines.append(accuracy.report())
    return Answer(value, lines)


def _with_stages(model: EfficiencyModel, names: Collection[str]) -> EfficiencyModel:
    """Return a model of some stages, in the order of the model.

    Raises:
        InputError: the model has no such stage.
    """
    for name in names:
        model.in_stage(name)
    kept = []
    for name, part in model.stages.items():
        if name in names:
            kept.append(part.stage)
    return replace(model, stage=kept[0], other_stages=tuple(kept[1:]))
