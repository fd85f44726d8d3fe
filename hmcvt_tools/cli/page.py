# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt page`."""

import click

from ..export.effect_tables import BOUND
from ..export.page import write_page
from . import common
from .common import Answer
from .export import bound_option


@common.command(
    "page",
    """
  hmcvt page params/tractor.yaml --out tractor.html
  hmcvt page params/hm4.yaml --out hm4.html --json""",
)
@click.argument("params", metavar="MODEL.yaml")
@click.option(
    "--out",
    required=True,
    type=common.OutputFile(),
    metavar="PAGE.html",
    help="File to write.",
)
@bound_option
def command(params: str, out: str, bound: float | None) -> Answer:
    """Write a page to play with the model: sliders, map, optimum, losses by part.

    One file below 1 MB that needs no network; the browser computes with the equations of the
    exported C.
    """
    common.keep_inputs([params], [out])
    model = common.model_from(params)
    accuracy = write_page(model, out, BOUND if bound is None else bound)
    common.note_oil_temperature(model)
    value = {
        "path": out,
        "fingerprint": model.fingerprint,
        "stages": list(model.stages),
        "effects": None if accuracy is None else accuracy._asdict(),
    }
    lines = [f"page of model {model.fingerprint} written to {out}"]
    if accuracy is not None:
        lines.append(accuracy.report())
    return Answer(value, lines)
