# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Checks of the types that public functions are given, with errors that name what is wanted."""

import os
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import InputError

_FILE_KINDS = {
    "hmcvt-model": "a parameter file of a model",
    "hmcvt-transmission": "a transmission file",
    "hmcvt-engine": "an engine file",
    "hmcvt-mapping": "a mapping of columns",
}
"""What the files of each schema are, without the version."""

_STATED_SCHEMA = re.compile(r"^schema: *['\"]?([\w/-]+)", re.MULTILINE)


def require_seed(value: Any) -> None:
    """Raise an `InputError` where an argument is not the seed of random numbers."""
    is_whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not is_whole or value < 0:
        raise InputError(f"seed = {value!r} is not a whole number from 0 on")


def one_holdout(holdout: Any, validation: Any) -> Any:
    """Return the samples held out, which a former name of the argument may state.

    Raises:
        InputError: both are given.
    """
    if holdout is None:
        return validation
    if validation is not None:
        raise InputError("holdout and validation are one argument: give holdout")
    return holdout


def kind_of_schema(schema: object) -> str | None:
    """Return what kind of file states a schema, None for an unknown one."""
    return _FILE_KINDS.get(str(schema).partition("/")[0])


def _kind_of_text(text: str) -> str:
    """Return what kind of file holds a text."""
    stated = _STATED_SCHEMA.search(text)
    kind = kind_of_schema(stated[1]) if stated else None
    return kind or "a file"


def _is_content(value: Any) -> bool:
    """Whether a value is the text of a file, not its path."""
    is_text = isinstance(value, str)
    return is_text and ("\n" in value or _STATED_SCHEMA.match(value) is not None)


def described(value: Any) -> str:
    """Return what a value is, in words for an error message."""
    name = type(value).__name__
    if value is None:
        return "None"
    if _is_content(value):
        return f"the text of {_kind_of_text(value)}"
    if isinstance(value, str):
        return f"the text {value!r}"
    if isinstance(value, Mapping):
        kind = kind_of_schema(value.get("schema"))
        if kind is not None:
            return f"the content of {kind} as a {name}"
    if isinstance(value, os.PathLike):
        return f"the path {os.fspath(value)!r}"
    if is_dataframe(value):
        return "a pandas DataFrame"
    if isinstance(value, np.ndarray):
        return f"a NumPy array of shape {value.shape}"
    article = "a"
    if name[0] in "aeiouAEIOU":
        article = "an"
    return f"{article} {name}"


def is_dataframe(value: Any) -> bool:
    """Whether a value is a pandas DataFrame, without importing pandas."""
    return type(value).__name__ == "DataFrame" and hasattr(value, "columns")


def is_path(value: Any) -> bool:
    """Whether a value names a file."""
    return isinstance(value, (str, os.PathLike))


def wrong_type(argument: str, wanted: str, given: Any, hint: str = "") -> InputError:
    """Return the error for an argument of another type.

    Args:
        argument: name of the argument.
        wanted: what it is to be, in words.
        given: what it is.
        hint: what to do instead, if known.
    """
    text = f"{argument}: {wanted} is wanted, not {described(given)}"
    if hint:
        text = f"{text}; {hint}"
    return InputError(text)


def require_path(value: Any, argument: str, wanted: str, hint: str = "") -> None:
    """Raise an `InputError` where an argument is not the path of a file."""
    if not is_path(value) or _is_content(value):
        raise wrong_type(argument, f"the path of {wanted}", value, hint)
