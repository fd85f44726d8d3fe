# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The folder of C that `export_c` writes: model, self-test, description."""

import os
from pathlib import Path

from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.model.oil import without_oil_temperature
from hmcvt_core.version import __version__

from . import c_text
from .a2l import a2l_text
from .c_model import MODEL_HEADER, MODEL_SOURCE, CModel, c_model, template
from .effect_tables import BOUND, TABLES_REMARK, Accuracy
from .folder import require_new, write_folder
from .stage_choice import CHECK as STAGE_CHECK
from .stage_choice import HEADER as STAGE_HEADER
from .stage_choice import SOURCE as STAGE_SOURCE
from .stage_choice import VECTORS as STAGE_VECTORS
from .stage_choice import stage_choice_files
from .vectors import TABLE_TOLERANCE, vectors_csv

CHECK_SOURCE = "check.c"
VECTORS = "vectors.csv"
README = "README.md"
A2L = "hmcvt_model.a2l"
_STAGE_FILES = (
    ((STAGE_HEADER, STAGE_SOURCE), "the choice of the stage, with hysteresis"),
    ((STAGE_CHECK, STAGE_VECTORS), "self-test of that choice, with answers of Python"),
)
SINGLE_TOLERANCE = 1e-4
SEARCH_TOLERANCE = 1e-6
"""Tolerances of the self-test, as parts of each quantity."""


def export_c(
    model: EfficiencyModel,
    folder: str | os.PathLike[str],
    precision: str = "double",
    bound: float = BOUND,
) -> Accuracy | None:
    """Write a model as C99 for a controller, with a self-test.

    In double precision the code gives every bit of the answers of Python. Effects become tables,
    which are refined until their error is within a bound at 99 % of random points.

    Args:
        model: all its stages are exported; they are numbered from 0 in their order.
        folder: does not exist yet.
        precision: `double` or `single`.
        bound: error of the efficiency that tables of effects may make [-].

    Returns:
        What the tables of effects keep, or None without effects.

    Raises:
        InputError: the folder exists, or the model or precision cannot be exported.
    """
    require_new(Path(folder))
    code = c_model(model, precision, bound)
    write_c(model, code, folder, precision)
    return code.accuracy


def write_c(
    model: EfficiencyModel,
    code: CModel,
    folder: str | os.PathLike[str],
    precision: str = "double",
) -> None:
    """Write the C of a model, as `export_c` does.

    Args:
        model: all its stages are exported.
        code: of the model, in the precision.
        folder: does not exist yet.
        precision: `double` or `single`.

    Raises:
        InputError: the folder exists.
    """
    target = Path(folder)
    require_new(target)
    write_folder(target, _files(model, code, precision))


def _files(model: EfficiencyModel, code: CModel, precision: str) -> dict[str, str]:
    """Return the text of each file of a folder of C, by name."""
    vectors = vectors_csv(model, precision, code.effects)
    tolerance = 0.0 if code.accuracy is None else TABLE_TOLERANCE
    check = template(CHECK_SOURCE).substitute(
        prediction_tolerance=tolerance,
        single_tolerance=max(tolerance, SINGLE_TOLERANCE),
        search_tolerance=max(tolerance, SEARCH_TOLERANCE),
    )
    of_choice = stage_choice_files(model, code.accuracy is not None)
    rows = []
    for names, content in _STAGE_FILES:
        if of_choice.keys() >= set(names):
            listed = ", ".join(f"`{name}`" for name in names)
            rows.append(f"| {listed} | {content} |\n")
    count = vectors.count("\n") - 2
    return {
        MODEL_HEADER: code.header,
        MODEL_SOURCE: code.source,
        CHECK_SOURCE: check,
        VECTORS: vectors,
        A2L: a2l_text(model, precision),
        README: _readme(model, code, precision, count, "".join(rows)),
        **of_choice,
    }


def _readme(
    model: EfficiencyModel,
    code: CModel,
    precision: str,
    vectors: int,
    stage_files: str,
) -> str:
    names = []
    for number, name in enumerate(model.stages):
        names.append(f" {number} `{c_text.comment(name)}`")
    return template(README).substitute(
        fingerprint=model.fingerprint,
        version=__version__,
        stage_list=",".join(names),
        precision=precision,
        vectors=vectors,
        exactness=_exactness(code),
        stage_files=stage_files,
        oil=_oil(model),
    )


def _oil(model: EfficiencyModel) -> str:
    """Return for which oil temperature the code answers."""
    clauses = without_oil_temperature(model.effects)
    if not clauses:
        return (
            "The model reads none: it answers for oil as warm as that of the tests from which it "
            "was identified."
        )
    return (
        f"The code has no input for it: {', '.join(clauses)}. No option of the export chooses "
        "another temperature; `hmcvt predict --oil-temperature` answers at any."
    )


def _exactness(code: CModel) -> str:
    """Return how close the answers are to those of Python."""
    if code.accuracy is None:
        return "With it, double precision gives every bit of Python's answers."
    return f"This model holds {code.accuracy.report()}. {TABLES_REMARK}"
