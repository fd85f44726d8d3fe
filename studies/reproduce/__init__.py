# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Every number and figure of the paper beside ours."""
