# SPDX-License-Identifier: Apache-2.0
"""The exceptions that hmcvt raises on purpose."""


class HmcvtError(ValueError):
    """Base of every error that hmcvt raises on purpose; its text is one line for a person."""


class InputError(HmcvtError):
    """What the user gave is wrong: the text names the place, the value and the range allowed."""


class IdentificationError(HmcvtError):
    """The samples cannot carry the identification asked for."""
