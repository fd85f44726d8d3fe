# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The exceptions that hmcvt raises on purpose."""

_MOST = 1000  # characters


class HmcvtError(ValueError):
    """Base of every error that hmcvt raises on purpose; its text is one line for a person."""

    def __init__(self, text: str) -> None:
        # It may quote a file: what stands there must not break the line or bury the reason.
        line = " ".join(text.splitlines())
        super().__init__(line if len(line) <= _MOST else f"{line[: _MOST - 4]} ...")


def in_one_line(error: Exception) -> str:
    """Return the text of an error as one line; its kind where it has no text."""
    return " ".join(str(error).split()) or type(error).__name__


class InputError(HmcvtError):
    """What the user gave is wrong: the text names the place, the value and the range allowed."""


class IdentificationError(HmcvtError):
    """The samples cannot carry the identification asked for."""
