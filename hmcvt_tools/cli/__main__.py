# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m hmcvt_tools.cli` is `hmcvt`."""

from . import main

main()
