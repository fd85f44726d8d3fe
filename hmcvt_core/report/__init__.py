# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a person looks at: the page of a diagnosis and the pictures (extra `report`).

The page is one self-contained HTML file. It loads nothing, and says all without its script, which
sorts, marks and saves.
"""

from __future__ import annotations

import base64
import hashlib
import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..benches.unit import PARAMETERS, UnitDiagnosis
from ..diagnosis import Diagnosis, words
from ..diagnosis.result import GAP_SIGNIFICANCE, REGION_SIGNIFICANCE
from ..files import picture
from ..files.atomic import write_atomically
from ..identification import Identification
from ..model.model import EfficiencyModel
from ..transmission.parameters import PARAMETER_UNITS
from ..transmission.ranges import RPM
from .gap import columns, draw_residuals, gap_map, residual_table, residuals
from .losses import before_and_after, draw_losses, lost_power, means
from .pictures import draw_drive_line, draw_fit, draw_surface, drawn, save
from .style import FORMATS, TEMPLATES, check_drawable, render

__all__ = [
    "FORMATS", "check_drawable", "draw_drive_line", "draw_fit", "draw_losses", "draw_residuals",
    "draw_surface", "html", "save", "write_html",
]

# What `plot_map` and `plot` of these show.
picture.register(EfficiencyModel, partial(drawn, draw_surface))
picture.register(Identification, partial(drawn, draw_fit))
picture.register(Diagnosis, partial(drawn, draw_residuals))


def write_html(diagnosis: Diagnosis | UnitDiagnosis, path: str | os.PathLike[str]) -> None:
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
    if isinstance(diagnosis, UnitDiagnosis):
        return _page(diagnosis.found, PARAMETERS, rmse=diagnosis.rmse, watts=None)
    base, model, samples = diagnosis.base, diagnosis.model, diagnosis.samples
    speed, load = float(np.median(samples.engine_speed)), float(np.median(samples.load_torque))
    heat = (None if samples.oil_temperature is None
            else float(np.median(samples.oil_temperature)))
    before = lost_power(base, speed, load, heat)
    after = before if model is base else lost_power(model, speed, load, heat)
    return _page(diagnosis, PARAMETER_UNITS, speed=speed, load=load, rpm=RPM,
                 watts=before_and_after(before, after), means=means(before, after))


def _page(found: Diagnosis, units: Mapping[str, str], **more: Any) -> str:
    script = (TEMPLATES / "page.js.j2").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return render(
        "diagnosis.html.j2", script=script, script_hash=digest, tests=residual_table(found),
        found=found, words=words, units=units, map=gap_map(found),
        residuals=residuals(found), columns=columns(found), gap_significance=GAP_SIGNIFICANCE,
        region_significance=REGION_SIGNIFICANCE, **more)
