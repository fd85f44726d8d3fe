# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m hmcvt_core.cli` is `hmcvt`."""

from ..moved import tools

tools("hmcvt_tools.cli").main()
