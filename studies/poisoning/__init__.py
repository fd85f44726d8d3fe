# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Attacks on a refit by bad samples, some or all: how far do they spoil the served model?"""
