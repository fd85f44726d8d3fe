# SPDX-License-Identifier: Apache-2.0
"""A fleet: identify and diagnose every bench log of a folder, many at a time.

settings    what to do with each log
plan        which logs there are, and which are finished already
study       one log: samples in, outcome out
processes   many logs on this machine
cluster     many logs on a Dask cluster
results     the files of a finished log; one run at a time in a folder
run         from plan to results
outliers    robust z scores over the fleet
summary     the table over the fleet
"""
