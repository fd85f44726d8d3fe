# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Description of a transmission, and the registry of the quantities that describe its state.

quantities  the registry: name, unit, range, meter and headings of each quantity
ranges      operating points, and ranges that code uses by name
units       units as people write them; `words` of headings in several languages
stage       the gear train of one stage (`teeth`, `clutches`)
parameters  the three hydraulic parameters
check       what the gear ratios make of the speeds
new_file    a transmission file from ratios or tooth counts
mapping     fields of a YAML mapping; errors name the place
"""
