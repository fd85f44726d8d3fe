# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Maps for MATLAB and Octave: a .mat file, or the same as a script."""

import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.transmission.ranges import Array
from hmcvt_core.version import __version__

from .c_model import require_exportable
from .maps import AXIS_UNITS, TABLE_UNITS, StageMap, axes, stage_maps

SUFFIXES = (".mat", ".m")
_NAME = "hmcvt"


def export_mat(model: EfficiencyModel, path: str | os.PathLike[str]) -> None:
    """Write maps of every stage for lookup tables in MATLAB, Simulink or Octave.

    The file holds one struct `hmcvt`: fingerprint, axes, units, and an array of stages with the
    tables efficiency, output_speed, engine_torque and power_loss. A file of that name is replaced.

    Args:
        model: its formulation is `power_balance`; effects count.
        path: file to write, .mat (version 5) or .m (a script).

    Raises:
        InputError: the path has another suffix, or the model cannot be exported.
    """
    target = Path(path)
    if target.suffix not in SUFFIXES:
        raise InputError(f"{target}: the suffix must be {' or '.join(SUFFIXES)}")
    if target.is_dir():
        raise InputError(f"{target}: is a folder")
    require_exportable(model)
    maps = stage_maps(model)
    if target.suffix == ".m":
        write_atomically(target, _script(model, maps))
    else:
        write_atomically(target, _mat_bytes(model, maps))


def _header(model: EfficiencyModel) -> dict[str, Any]:
    """Return what holds for all stages, by field."""
    fields: dict[str, Any] = {
        "fingerprint": model.fingerprint,
        "source": f"hmcvt {__version__}",
    }
    fields.update(zip(AXIS_UNITS, axes(), strict=True))
    fields["units"] = AXIS_UNITS | TABLE_UNITS
    return fields


def _mat_bytes(model: EfficiencyModel, maps: Sequence[StageMap]) -> bytes:
    kinds = [("name", object), ("efficiency_error", object)]
    kinds += [(name, object) for name in TABLE_UNITS]
    stages = np.empty((1, len(maps)), dtype=kinds)
    for number, stage in enumerate(maps):
        row = stages[0, number]
        row["name"] = stage.name
        row["efficiency_error"] = stage.efficiency_error
        for name, table in stage.tables.items():
            row[name] = table
    # Imported where used: it takes half a second.
    from scipy.io import savemat

    buffer = io.BytesIO()
    savemat(buffer, {_NAME: {**_header(model), "stages": stages}}, oned_as="row")
    return buffer.getvalue()


def _script(model: EfficiencyModel, maps: Sequence[StageMap]) -> str:
    """Return the same as a script, which makes the struct in the workspace."""
    lines = [
        f"% Maps of the model {model.fingerprint}, written by hmcvt {__version__}."
    ]
    for field, value in _header(model).items():
        if field == "units":
            lines += [
                f"{_NAME}.units.{name} = {_text(unit)};" for name, unit in value.items()
            ]
        elif isinstance(value, str):
            lines.append(f"{_NAME}.{field} = {_text(value)};")
        else:
            lines.append(f"{_NAME}.{field} = {_row(value)};")
    shape = " ".join(str(axis.size) for axis in axes())
    for number, stage in enumerate(maps, 1):
        entry = f"{_NAME}.stages({number})"
        lines.append(f"{entry}.name = {_text(stage.name)};")
        lines.append(f"{entry}.efficiency_error = {stage.efficiency_error!r};")
        for name, table in stage.tables.items():
            values = _row(table.ravel(order="F"))
            lines.append(f"{entry}.{name} = reshape({values}, [{shape}]);")
    return "\n".join(lines) + "\n"


def _text(value: str) -> str:
    return "'" + value.replace("'", "''") + "'"


def _row(values: Array) -> str:
    """Return a row vector with the digits that give its numbers back exactly."""
    cells = []
    for value in values.tolist():
        cells.append("NaN" if np.isnan(value) else repr(value))
    return "[" + " ".join(cells) + "]"
