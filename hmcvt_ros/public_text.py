# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What of a text may leave the machine, or enter a log.

Everyone on the network reads `/diagnostics`, `/rosout`, `~/model` and the replies of services. They
name files as within the state folder. Texts from the network may hold line breaks and escape codes,
which would forge lines of a log.
"""

import os
import re
from collections.abc import Iterable
from pathlib import Path

_FOLDERS = re.compile(r"""(?<![\w~./)-])(?:/[^/\s"',;:]+)+/""")
"""Folders in an absolute path."""
_FURTHER = r"""(?:[^/\s"',;:]+/)*"""
"""Folders in the rest of a path."""


def printable(text: str) -> str:
    """Return a text whose control characters are written as escapes."""
    if text.isprintable():
        return text
    characters = []
    for character in text:
        if character.isprintable():
            characters.append(character)
        else:
            characters.append(character.encode("unicode_escape").decode())
    return "".join(characters)


class PublicText:
    """Names files as within the state folder: where that is, is not disclosed."""

    def __init__(self, folder: Path, files: Iterable[str] = ()) -> None:
        """Take the paths that texts may name.

        Args:
            folder: state folder.
            files: other files of the node. Their folders are known here also where they hold
                spaces, which end a path in a text.
        """
        home = os.path.expanduser("~")
        paths = [folder, Path(home), *map(Path, files)]
        folders = set[str]()
        for path in paths:
            for form in (path.absolute(), path.resolve()):
                folders.update(f"{each}/" for each in (form, *form.parents))
        self._state = {f"{folder.absolute()}/", f"{folder.resolve()}/"}
        # The root alone is no folder worth hiding, and "/" stands in many texts.
        known = sorted(folders - self._state - {"//"}, key=len, reverse=True)
        either = "|".join(map(re.escape, known)) or "(?!)"
        self._known = re.compile(f"(?:{either}){_FURTHER}")

    def __call__(self, text: str) -> str:
        """Return a text without folders of absolute paths and without control characters."""
        for folder in self._state:
            text = text.replace(folder, "")
        return printable(_FOLDERS.sub("", self._known.sub("", text)))

    def names_folders(self, text: str) -> bool:
        """Whether a text names folders that must not leave the machine."""
        return self(text) != printable(text)
