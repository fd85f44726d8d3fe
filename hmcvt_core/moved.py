# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Names that moved to `hmcvt_tools` and stay importable from here, with a warning.

The core imports nothing above it; it looks these names up only when somebody asks for one.
"""

import warnings
from collections.abc import Collection
from importlib import import_module
from typing import Any

from .errors import InputError

TOOLS = "hmcvt_tools"


def from_tools(
    old: str, name: str, moved: Collection[str] | None, new: str = TOOLS
) -> Any:
    """Return a name that moved to another module, with a `DeprecationWarning`.

    Args:
        old: module that it is asked of.
        name: of a function, class or constant.
        moved: names that moved; None for all of the new module.
        new: module that holds it now.

    Raises:
        AttributeError: no such name was ever there.
        InputError: a library that the new module needs is not installed.
    """
    if (moved is not None and name not in moved) or name.startswith("__"):
        raise AttributeError(f"module {old!r} has no attribute {name!r}")
    item = getattr(tools(new), name)
    warnings.warn(
        f"{old}.{name} has moved: import it from {new}",
        DeprecationWarning,
        stacklevel=3,
    )
    return item


def tools(module: str = TOOLS) -> Any:
    """Return a module of `hmcvt_tools`, imported when it is asked for.

    Raises:
        InputError: a library that it needs is not installed.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        raise InputError(
            f'{module} needs {error.name}: pip install ".[tools]"'
        ) from None
