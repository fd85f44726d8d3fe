# SPDX-License-Identifier: Apache-2.0
"""Files on disk: bench tables, row-exact errors, atomic writes, shipped data."""
