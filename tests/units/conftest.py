# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
from cli.running import hmcvt

__all__ = ["hmcvt"]
