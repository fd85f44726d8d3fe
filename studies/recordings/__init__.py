# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Random recordings of known content, imported: is a value ever wrong without a word?"""
