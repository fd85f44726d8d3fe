# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt import-csv`, the older name of `hmcvt import`."""

from __future__ import annotations

from .import_table import named

command = named("import-csv")
