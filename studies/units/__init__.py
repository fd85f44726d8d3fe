# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The loss terms of the paper judged on single pumps and motors, real ones and simulated ones."""
