# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bad samples among good ones: what a refit makes of them."""
