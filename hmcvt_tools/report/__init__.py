# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Pages and pictures of results for people (extra `report`).

A page is one self-contained HTML file. It loads nothing and is complete without its script, which
sorts, marks and saves. These modules draw the page and the sheet of a diagnosis:

answer      what page and sheet lead with: causes, size, next step
axes        how the axes of a diagnosis are shown
gap_map     maps of the estimated gap and its standard deviation
residuals   residuals before and after
watts       where the watts go, before and after
figures     all of these as the templates of the page name them
sheet       one page of paper

The others draw models, fits, watches, test plans, logs, missions and studies:

pictures    files with a picture; losses, surface, drive_line, power_maps, power_paths,
            operating_points and panels draw them
mission     pictures and page of a mission
study       page of a study
style       letters, colours, formats
"""

import base64
import hashlib
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from hmcvt_core.benches.baseline import ChangeDiagnosis
from hmcvt_core.benches.unit import CHANNEL_UNITS, PARAMETERS, UnitChange, UnitDiagnosis
from hmcvt_core.diagnosis import Diagnosis, Isolability, settings
from hmcvt_core.diagnosis.results import text as words
from hmcvt_core.errors import InputError
from hmcvt_core.files import picture
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.identification import Identification
from hmcvt_core.model.breakdown import Breakdown
from hmcvt_core.model.domain import EfficiencyMap
from hmcvt_core.model.engine import Engine
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.monitoring import Opening
from hmcvt_core.transmission.parameters import PARAMETER_NAMES

from ..estimation import Estimate
from . import figures
from .operating_points import draw_operating_points
from .panels import draw_opening, draw_separation
from .pictures import draw_fit, draw_surface, drawn
from .power_maps import draw_breakdown, draw_engine
from .sheet import sheet
from .style import TEMPLATES, render, report_format
from .surface import draw_map

# What `plot_map` and `plot` of these show.
picture.register(EfficiencyModel, partial(drawn, draw_surface))
picture.register(EfficiencyMap, partial(drawn, draw_map))
picture.register(Identification, partial(drawn, draw_fit))
picture.register(Diagnosis, figures.plot_diagnosis)
picture.register(Isolability, partial(drawn, draw_separation))
picture.register(Opening, partial(drawn, draw_opening))
picture.register(Engine, partial(drawn, draw_engine))
picture.register(Breakdown, partial(drawn, draw_breakdown))
picture.register(Estimate, partial(drawn, draw_operating_points))


def write_html(
    diagnosis: Diagnosis | UnitDiagnosis | UnitChange, path: str | os.PathLike[str]
) -> None:
    """Write the page of a diagnosis, whole or not at all.

    Raises:
        InputError: the path does not end in .html, or Jinja2 or matplotlib is missing.
        OSError: the folder cannot be written or is full; an old file is untouched.
    """
    if Path(path).suffix.lower() not in (".html", ".htm"):
        raise InputError(
            f"{os.fspath(path)}: the page is HTML: end the name in .html "
            "(write_report takes .pdf too)"
        )
    write_atomically(Path(path), html(diagnosis))


def write_report(
    diagnosis: Diagnosis | UnitDiagnosis | UnitChange,
    path: str | os.PathLike[str],
    remarks: Sequence[str] = (),
) -> None:
    """Write the report of a diagnosis: its page (.html), or one sheet of paper (.pdf).

    Args:
        diagnosis: of a transmission, of a unit, or of a system that you define.
        path: its ending names the format.
        remarks: notes of the diagnosis that the sheet holds even where it has no room for all; the
            page has all.

    Raises:
        InputError: the ending names no format, or what draws is missing.
        OSError: the folder cannot be written or is full; an old file is untouched.
    """
    if report_format(os.fspath(path)) == ".html":
        write_html(diagnosis, path)
        return
    if isinstance(diagnosis, (UnitDiagnosis, UnitChange)):
        diagnosis = diagnosis.diagnosis
    write_atomically(Path(path), sheet(diagnosis, remarks=remarks))


def html(diagnosis: Diagnosis | UnitDiagnosis | UnitChange) -> str:
    """Return the page of a diagnosis; the same diagnosis gives the same text.

    Raises:
        InputError: Jinja2 or matplotlib is missing.
    """
    rmse = baseline = None
    reference = "paper's terms"
    if isinstance(diagnosis, UnitDiagnosis):
        found, rmse, names = diagnosis.diagnosis, diagnosis.rmse, tuple(PARAMETERS)
    elif isinstance(diagnosis, UnitChange):
        found = diagnosis.diagnosis
        rmse = diagnosis.rmse
        names = tuple(found.parameters)
        reference = "sound unit"
        baseline = diagnosis.baseline
    elif isinstance(diagnosis, ChangeDiagnosis):
        found, names = diagnosis, tuple(diagnosis.parameters)
        baseline = diagnosis.baseline
    else:
        found, names = diagnosis, tuple(diagnosis.parameters)
    if isinstance(found.base, EfficiencyModel) and baseline is None:
        names = PARAMETER_NAMES
    script = (TEMPLATES / "page.js.j2").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return render(
        "diagnosis.html.j2",
        script=script,
        script_hash=digest,
        found=found,
        rmse=rmse,
        reference=reference,
        baseline=baseline,
        channel_units={
            name.removesuffix("_loss"): unit for name, unit in CHANNEL_UNITS.items()
        },
        names=names,
        units={name: entry.unit for name, entry in found.parameters.items()},
        transmission=isinstance(found.base, EfficiencyModel),
        words=words,
        figures=figures,
        limits=settings,
    )
