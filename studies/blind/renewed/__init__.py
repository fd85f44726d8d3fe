# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The renewed plant: an opponent's bench, with forms of the literature that the library lacks.

It shares the steady-state solver of `studies.blind.bench`, and of `hmcvt_core` the errors and the
file of each transmission. Losses, base errors, plans, heat and meters are its own. Its generator is
frozen: `campaign.VERSION` changes whenever equal seeds would no longer give equal readings.
"""
