# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The endurance trial of the node: `make soak`, which writes docs/studies/soak.md.

This process makes the load, measures and reports; the node and a bare relay to compare it with
are processes of their own, reached over DDS on the loopback interface.

trial        steady load, rising load, load during refits, nonsense; `load` sends and receives,
             `points` assigns each answer to what was sent
processes    the node and the relay, started and measured; `report` writes the document
latency      time to an answer, of the node and of `relay` (a command of its own)
faults       ordinary faults one at a time
fuzz_inputs  nonsense on the inputs; `fuzz_bench` on the bench samples, `edit_log` in their log
kill_node    kills at random moments; `kill_lines` before each line that writes (`kill_trials`)
verdicts     campaigns diagnosed through the node and by the command line (likewise)
"""
