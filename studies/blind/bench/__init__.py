# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A plant with a bench around it as benches are: sessions, meters, texture, warm oil, plans.

`python -m studies.blind --plant bench` has its campaigns diagnosed. The physics (`trains`, `plant`)
are written apart from the served model and solved by another method; with every property of
`properties.Bench` switched off they agree with it to 1e-6. Effects come from the forms of the twin
(`studies.blind.drag`, `hydrostatics`, `meters`) and from `unlisted_losses`.
"""
