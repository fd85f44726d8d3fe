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
from ..diagnosis import Diagnosis, Isolability, settings
from ..diagnosis.results import text as words
from ..files import picture
from ..files.atomic import write_atomically
from ..identification import Identification
from ..model.model import EfficiencyModel
from ..monitoring import Opening
from ..transmission.parameters import PARAMETER_NAMES
from . import figures
from .panels import draw_opening, draw_separation
from .pictures import draw_fit, draw_surface, drawn
from .style import TEMPLATES, render

# What `plot_map` and `plot` of these show.
picture.register(EfficiencyModel, partial(drawn, draw_surface))
picture.register(Identification, partial(drawn, draw_fit))
picture.register(Diagnosis, partial(drawn, figures.draw_residuals))
picture.register(Isolability, partial(drawn, draw_separation))
picture.register(Opening, partial(drawn, draw_opening))


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
    rmse = None
    if isinstance(diagnosis, UnitDiagnosis):
        found, rmse, names = diagnosis.diagnosis, diagnosis.rmse, tuple(PARAMETERS)
    else:
        found, names = diagnosis, tuple(diagnosis.parameters)
    if isinstance(found.base, EfficiencyModel):
        names = PARAMETER_NAMES
    script = (TEMPLATES / "page.js.j2").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return render(
        "diagnosis.html.j2",
        script=script,
        script_hash=digest,
        found=found,
        rmse=rmse,
        names=names,
        units={name: entry.unit for name, entry in found.parameters.items()},
        transmission=isinstance(found.base, EfficiencyModel),
        words=words,
        figures=figures,
        limits=settings,
    )
