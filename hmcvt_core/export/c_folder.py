# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The folder of C that `export_c` writes: model, self-test, description."""

import os
from pathlib import Path

from ..model.model import EfficiencyModel
from ..version import __version__
from . import c_text
from .a2l import a2l_text
from .c_model import MODEL_HEADER, MODEL_SOURCE, c_model, template
from .folder import require_new, write_folder
from .vectors import vectors_csv

CHECK_SOURCE = "check.c"
VECTORS = "vectors.csv"
README = "README.md"
A2L = "hmcvt_model.a2l"


def export_c(
    model: EfficiencyModel,
    folder: str | os.PathLike[str],
    precision: str = "double",
) -> None:
    """Write a model as C99 for a controller, with a self-test.

    In double precision the code gives every bit of the answers of Python.

    Args:
        model: all its stages are exported; they are numbered from 0 in their order.
        folder: does not exist yet.
        precision: `double` or `single`.

    Raises:
        InputError: the folder exists, or the model or precision cannot be exported.
    """
    target = Path(folder)
    require_new(target)
    write_folder(target, c_files(model, precision))


def c_files(model: EfficiencyModel, precision: str) -> dict[str, str]:
    """Return the text of each file of a folder of C, by name."""
    code = c_model(model, precision)
    vectors = vectors_csv(model, precision)
    check = template(CHECK_SOURCE).substitute(prediction_tolerance="0.0")
    return {
        MODEL_HEADER: code.header,
        MODEL_SOURCE: code.source,
        CHECK_SOURCE: check,
        VECTORS: vectors,
        A2L: a2l_text(model, precision),
        README: _readme(model, precision, vectors.count("\n") - 2),
    }


def _readme(model: EfficiencyModel, precision: str, vectors: int) -> str:
    names = []
    for number, name in enumerate(model.stages):
        names.append(f" {number} `{c_text.comment(name)}`")
    return template(README).substitute(
        fingerprint=model.fingerprint,
        version=__version__,
        stage_list=",".join(names),
        precision=precision,
        vectors=vectors,
        remarks="",
    )
