# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The efficiency model in a user's hands: lookup, optimum, map, domain, parameter file.

model            `EfficiencyModel`, one or several stages with parameters and effects
operating_point  stroke and load from what meters show
intervals        intervals that standard errors stand for
oil              remarks on effects that need the oil temperature
optimum          the working point that loses least, of a stage or of the drive line
engine           the engine before the transmission: full-load curve and fuel map
breakdown        where the power goes
domain           where the data of a model reach; `Prediction` and `EfficiencyMap`
accuracy         how far predictions are from measurements
parameter_file   a model as YAML, with units and provenance
measured_unit    what the test of a single pump or motor contributes to a model
plausibility     whether samples can be of this transmission (`signs` of speed and pressure)
staged_samples   the stage of each sample
checks           whether arguments are models or samples; `part_checks`: parts of a model
"""
