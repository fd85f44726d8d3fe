# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Tables with their own names and units, read in six steps.

1. `reading`: a file becomes rows of text (encoding; sheets of Excel: `workbook`).
2. `header`: separator or sheet, and the row of the header, are chosen (.lvm files: `labview`); an
   optional row below the header holds units; the rest is data.
3. `proposal`: `rules` states which words, units and sides name which quantity; each column gets
   a proposal with its reason, and what stays open becomes a question.
4. conversion: `numbers` and `stamps` read the cells, `units` converts them to SI.
5. `checks`: values that contradict each other or look like another unit are refused; `shafts`
   finds exchanged shafts and odd strokes by the speed ratio.
6. samples: `raw` makes bench samples, without rows that hold no test (`summaries`, `no_tests`);
   `recordings` cuts a recording into steady windows, and `clocks` joins its clocks.

`unit_table` reads tests of one pump or motor (units that it does not state: `agreement`), `matrix`
a map with one axis along its header. `mapping` is the file that keeps the choice of columns.

A step never repairs what an earlier step left open: it asks, with the option that answers.
"""
