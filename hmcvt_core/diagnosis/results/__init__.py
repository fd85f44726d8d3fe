# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The outcome of a diagnosis as values, and in words."""
