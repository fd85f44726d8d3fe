# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
import signal


def pytest_configure():
    # A shell that starts the tests in the background has them ignore Ctrl-C, and so would do every
    # process that they start.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
