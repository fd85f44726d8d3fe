# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A page to play with a model: one file, which computes in the browser without a network."""

import json
import os
from pathlib import Path
from typing import Any

from hmcvt_core.errors import InputError
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.transmission import ranges
from hmcvt_core.transmission.ranges import RPM
from hmcvt_core.version import __version__

from .c_model import CModel, c_model, template
from .effect_tables import BOUND, TABLE_LOAD, TABLES_REMARK, Accuracy
from .javascript import javascript

PAGE = "page.html"
MAX_BYTES = 1_000_000
"""Size of a page that a mail or a web site takes without a thought."""
_HIGHEST_LOAD = 600.0
"""End of the slider [N m]: three times the usual load of the tractor of `params/`."""
_START = (1400.0 * RPM, 200.0)
"""Engine speed and load at which the page begins: those of the examples."""


def write_page(
    model: EfficiencyModel, path: str | os.PathLike[str], bound: float = BOUND
) -> Accuracy | None:
    """Write a model as a page with sliders, map, optimum and losses.

    The browser computes with the equations of the exported C, translated to JavaScript.

    Args:
        model: all its stages are on the page.
        path: file to write.
        bound: error of the efficiency that tables of effects may make [-].

    Returns:
        What the tables of effects keep, or None without effects.

    Raises:
        InputError: the model cannot be exported, or the page is too large.
    """
    target = Path(path)
    if target.is_dir():
        raise InputError(f"{target}: is a folder")
    code = c_model(model, bound=bound)
    text = page_text(model, code)
    size = len(text.encode())
    if size > MAX_BYTES:
        raise InputError(
            f"the page has {size} bytes, more than {MAX_BYTES}: raise --bound, which makes the "
            "tables of effects smaller, or take fewer stages"
        )
    write_atomically(target, text)
    return code.accuracy


def page_text(model: EfficiencyModel, code: CModel) -> str:
    """Return the page of a model and its C."""
    equations = javascript(code.header, code.source)
    # `</script>` in the name of a stage would end the script.
    facts = json.dumps(_facts(model, code)).replace("<", "\\u003c")
    text = template(PAGE).template
    return text.replace("/*MODEL*/", equations).replace("/*FACTS*/", facts)


def _facts(model: EfficiencyModel, code: CModel) -> dict[str, Any]:
    """Return what the page shows of a model besides its answers."""
    low, high = ranges.ENGINE_SPEED_LIMITS
    load = _HIGHEST_LOAD
    remark = ""
    if code.accuracy is not None:
        load = min(load, TABLE_LOAD.high)
        remark = f" It holds {code.accuracy.report()}. {TABLES_REMARK}"
    names = ", ".join(model.stages)
    return {
        "stages": list(model.stages),
        "speed": [round(low / RPM), round(high / RPM)],
        "load": [0.0, load],
        "start": _start(model),
        "states_domain": model.domain is not None,
        "subtitle": f"Stages {names}; steady operation, no shifts and no dynamics.",
        "footer": (
            f"Model {model.fingerprint} of hmcvt {__version__}. The equations are those of "
            f"`hmcvt export --format c`.{remark}"
        ),
    }


def _start(model: EfficiencyModel) -> list[float]:
    """Return stage number, stroke, engine speed and load at which the page begins.

    Stage and stroke are those of the highest efficiency.
    """
    start = [0.0, 0.5]
    highest = 0.0
    for number, part in enumerate(model.stages.values()):
        best = part.optimal_displacement_ratio(*_START)
        if best.efficiency > highest:
            highest = best.efficiency
            start = [float(number), float(best.displacement_ratio)]
    return [*start, *_START]
