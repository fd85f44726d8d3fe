# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnosis of single pumps and motors: makers' ones, and simulated ones with hidden losses."""
