# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Trials of the product, run from a clone; nothing of them is installed.

Of the paper:

reproduce    every number and figure of it
zero_stroke  its values at displacement ratio 0
stages       gear pairs that make the stages which it shows in a figure alone

Of the model and its identification:

edges        physics at its edges, against an independent solver
annealing    how near the annealing comes by itself
few_tests    intervals with few tests
coverage     how much of fresh truth the intervals hold
poisoning    what a refit makes of bad samples
knowledge    fuel that a strategy loses by a model of few tests

Of the diagnosis:

blind        a virtual bench whose physics are written apart, and its trial
gearbox      a gearbox of five stages and machines of its type
benchmark    other methods on the same campaigns
withheld     one cause, sealed and looked for (`make demo`)
systems      causes of machines that are no transmission
units        loss terms of single pumps and motors
real         real rigs and units
baseline     changes against a sound state
driver       campaigns in which something varied that nothing recorded
where        whether the reported regions hold the tests with a large gap
watch        false alarms and delay of `hmcvt watch`
sbc          simulation-based calibration of the probabilities
stability    whether the last digits of the inputs change an answer
consistency  whether a report contradicts itself
answers      the head of a report for each kind of answer

Of data in and results out:

tables, recordings, inputs  random files of known content, read
road                        `hmcvt estimate` on simulated tractors
export                      exported code: exactness, size, compilers

Of the code:

timing   how long everything takes (`make bench`)
soak     endurance and faults of the node (`make soak`)
mutants  whether the tests notice a wrong edit (`make mutants`)

Shipped data come from `cycles` (work cycles) and `engine_map` (the second engine). Many studies use
`page` (goals and what was reached), long ones `workers` (several processes, records that stay).
"""
