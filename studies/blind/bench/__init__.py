# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A plant with a bench around it as benches are: sessions, meters, texture, warm oil, plans.

`python -m studies.blind --plant bench` has its campaigns diagnosed. The physics (`trains`, `plant`)
are written apart from the served model and solved by another method; with every property of
`properties.Bench` switched off they agree with it to 1e-6. Effects come from the twin
(`studies.blind.catalogue`), from `listed_losses` and from `unlisted_losses`.

`campaign` makes the samples, `truth` what they hide; `judge` diagnoses one, `study` many, and
`scores` counts by `classes` of effects. `confusion` says what the readings can distinguish.
"""
