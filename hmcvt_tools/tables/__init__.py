# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Tables with their own names and units, read in six steps.

1. `reading`: a file becomes rows of text (encoding, separator, sheet).
2. `header`: one row is the header, an optional row below it holds units; the rest is data.
3. `proposal`: `rules` states which words, units and sides name which quantity; each column gets
   a proposal with its reason, and what stays open becomes a question.
4. conversion: `numbers` and `stamps` read the cells, `units` converts them to SI.
5. `checks`: values that contradict each other or look like another unit are refused.
6. samples: `hmcvt_tools.tables.raw` makes bench samples, `hmcvt_tools.tables.recordings` cuts a
   recording into steady windows.

`unit_table` reads tests of one pump or motor, `matrix` a map with one axis along its header.

A step never repairs what an earlier step left open: it asks, with the option that answers.
"""
