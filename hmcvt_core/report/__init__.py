# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a person looks at: the page of a diagnosis and the pictures (extra `report`).

The page is one self-contained HTML file. It loads nothing, and says all without its script, which
sorts, marks and saves.
"""

import base64
import hashlib
import os
from functools import partial
from pathlib import Path

from ..benches.unit import PARAMETERS, UnitDiagnosis
from ..diagnosis import Diagnosis, settings
from ..diagnosis.results import text as words
from ..files import picture
from ..files.atomic import write_atomically
from ..identification import Identification
from ..model.model import EfficiencyModel
from ..transmission.parameters import PARAMETER_UNITS
from . import figures
from .pictures import draw_fit, draw_surface, drawn
from .style import TEMPLATES, render

# What `plot_map` and `plot` of these show.
picture.register(EfficiencyModel, partial(drawn, draw_surface))
picture.register(Identification, partial(drawn, draw_fit))
picture.register(Diagnosis, partial(drawn, figures.draw_residuals))


def write_html(
    diagnosis: Diagnosis | UnitDiagnosis, path: str | os.PathLike[str]
) -> None:
    """Write the page of a diagnosis, whole or not at all.

    Raises:
        InputError: Jinja2 or matplotlib is missing.
        OSError: the folder cannot be written or is full; an old file is untouched.
    """
    write_atomically(Path(path), html(diagnosis))


def html(diagnosis: Diagnosis | UnitDiagnosis) -> str:
    """Return the page of a diagnosis; the same diagnosis gives the same text.

    Raises:
        InputError: Jinja2 or matplotlib is missing.
    """
    found, rmse, units = (
        (diagnosis.found, diagnosis.rmse, PARAMETERS)
        if isinstance(diagnosis, UnitDiagnosis)
        else (diagnosis, None, PARAMETER_UNITS)
    )
    script = (TEMPLATES / "page.js.j2").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return render(
        "diagnosis.html.j2",
        script=script,
        script_hash=digest,
        found=found,
        rmse=rmse,
        units=units,
        words=words,
        figures=figures,
        limits=settings,
    )
