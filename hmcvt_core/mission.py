# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Former place of `hmcvt_tools.mission`."""

from typing import Any

from .moved import from_tools


def __getattr__(name: str) -> Any:
    """Return a name that moved to `hmcvt_tools.mission`, with a `DeprecationWarning`."""
    return from_tools(__name__, name, None, "hmcvt_tools.mission")
