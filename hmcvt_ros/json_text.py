# SPDX-License-Identifier: Apache-2.0
"""Answers of the services as strict JSON, which has no NaN."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any


def json_text(data: Any) -> str:
    """Return plain data as strict JSON; a number that is not finite becomes null."""
    return json.dumps(_strict(data), allow_nan=False)


def _strict(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {str(key): _strict(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [_strict(value) for value in data]
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data
