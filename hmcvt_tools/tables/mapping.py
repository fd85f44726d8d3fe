# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A mapping file: the columns of a kind of table as YAML, so that an answer lasts.

An example:

    kind: hmcvt table mapping
    header_row: 3
    decimal: comma
    columns:
      engine_speed: "n_an [1/min]:1/min"
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hmcvt_core.errors import InputError

_KIND = "hmcvt table mapping"
_SETTINGS = (
    *("header_row", "sheet", "decimal", "names", "matrix"),
    *("dbc", "reference_torque", "friction_torque", "stage_names", "group"),
)
"""Settings of tables, and of logs."""


def mapping_text(
    columns: Mapping[str, str], settings: Mapping[str, int | str | None]
) -> str:
    """Return a mapping file.

    Args:
        columns: `COLUMN:UNIT` by quantity.
        settings: of a table or of a log; None is left out.
    """
    import yaml

    data: dict[str, Any] = {"kind": _KIND}
    for name, value in settings.items():
        if value is not None:
            data[name] = value
    data["columns"] = dict(columns)
    return str(yaml.safe_dump(data, sort_keys=False, allow_unicode=True))


def read_mapping(
    path: str | os.PathLike[str],
) -> tuple[dict[str, str], dict[str, Any]]:
    """Return columns by quantity, and settings, of a mapping file.

    Raises:
        InputError: the file cannot be read or is no mapping file.
    """
    import yaml

    try:
        data = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"{path}: not YAML: {error}") from None
    if not isinstance(data, dict) or data.get("kind") != _KIND:
        raise InputError(f"{path}: no mapping file: it needs a line 'kind: {_KIND}'")
    columns = data.get("columns")
    if not isinstance(columns, dict):
        raise InputError(f"{path}: needs 'columns' with one line a quantity")
    unknown = set(data) - {"kind", "columns", *_SETTINGS}
    if unknown:
        raise InputError(f"{path}: {sorted(unknown)[0]} is not known")
    texts = {str(quantity): str(text) for quantity, text in columns.items()}
    return texts, {name: data[name] for name in _SETTINGS if name in data}
