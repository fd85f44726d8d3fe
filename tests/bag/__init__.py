# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
