# SPDX-License-Identifier: Apache-2.0
"""Answers of the services as strict JSON, which has no NaN."""

from __future__ import annotations

import json
from typing import Any

from hmcvt_core.files import plain


def json_text(data: Any) -> str:
    """Return plain data as strict JSON; a number that is not finite becomes null."""
    return json.dumps(plain(data), allow_nan=False)
