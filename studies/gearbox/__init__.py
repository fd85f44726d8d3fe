# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A gearbox of five stages with reverse as a truth of its own, and machines of its type."""
