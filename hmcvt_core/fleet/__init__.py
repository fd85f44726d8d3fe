# SPDX-License-Identifier: Apache-2.0
"""A fleet: identify and diagnose every bench log of a folder, many at a time.

study       one log: samples and settings in, outcome out
executors   many logs side by side, on this machine or on a Dask cluster
run         from a folder of logs to their results; one run at a time in a folder
summary     the table over the fleet, with robust z scores
"""
