# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Former place of the command line, now `hmcvt_tools.cli`; `python -m` and imports still work."""

from typing import Any

from ..moved import from_tools


def __getattr__(name: str) -> Any:
    """Return a name that moved to `hmcvt_tools.cli`, with a `DeprecationWarning`."""
    new = "hmcvt_tools.cli" if name == "main" else "hmcvt_tools.cli.commands"
    return from_tools(__name__, name, None, new)
