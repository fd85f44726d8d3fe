# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A process for which the permissions of files hold, whoever runs the tests."""

import sys

# Root may read and write everywhere, unless it does without these rights; others have none of them.
_PR_CAPBSET_DROP, _CAP_DAC_OVERRIDE, _CAP_DAC_READ_SEARCH = 24, 1, 2
BOUND_BY_PERMISSIONS = (
    sys.executable, "-c",
    f"""import ctypes, os, sys
for right in {_CAP_DAC_OVERRIDE}, {_CAP_DAC_READ_SEARCH}:
    ctypes.CDLL(None).prctl({_PR_CAPBSET_DROP}, right, 0, 0, 0)
os.execv(sys.argv[1], sys.argv[1:])""")
"""Put before the command of the process."""
