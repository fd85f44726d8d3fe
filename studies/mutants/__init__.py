# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Mutation testing: `make mutants`, which asks whether the tests would notice a wrong edit.

mutations   the edits: one operator, number, comparison or name at a time
harness     copies of the project, which tests reach which lines, one mutant's trial
probe       prints many answers of the core; tells mutants apart that change none
"""
