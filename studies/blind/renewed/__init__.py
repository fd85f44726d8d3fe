# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The renewed plant: a third bench, with losses in forms of the literature that the library lacks.

It shares gear trains, steady-state solver and scores with `studies.blind.bench`, and with
`hmcvt_core` the errors and the file of each transmission. Its own are the losses (`listed`,
`unlisted`), base errors, plans and heat (`day`) and the `meters`. `oracle` answers with all forms
known, as an upper bound. The generator is frozen: `campaign.VERSION` changes whenever equal seeds
would no longer give equal readings.
"""
