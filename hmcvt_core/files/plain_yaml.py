# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""YAML that a person wrote: plain, of a known schema, without a key that means nothing."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .checks import kind_of_schema

if TYPE_CHECKING:
    import yaml

_TABLES = (".csv", ".tsv", ".txt")
# Chosen by us: a hundred times what the largest file of the project needs.
_MAX_BYTES = 1024 * 1024
_MAX_EVENTS = 40_000
"""Keys, values, and beginnings and ends of collections that a file may hold."""
_DEEPEST = 20  # levels; libyaml ends the process at some ten thousand


@contextmanager
def named(path: str | os.PathLike[str]) -> Iterator[None]:
    """Put the path before every message."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def read_tree(
    path: str | os.PathLike[str], schema: str
) -> tuple[dict[str, Any], yaml.Node]:
    """Read a mapping of a schema, and the tree of the text that it was made of."""
    path = Path(path)
    wanted = kind_of_schema(schema)
    tree, data = _parsed(path, wanted)
    if tree is None or not isinstance(data, dict):
        if path.suffix.lower() in _TABLES:
            raise InputError(f"is a table ({path.suffix}); wanted is {wanted}")
        raise InputError(
            f"holds no mapping; is it empty or cut off? wanted is {wanted}"
        )
    if data.get("schema") != schema:
        raise InputError(_other_schema(data.get("schema"), schema))
    _require_decimal_points(tree)
    return data, tree


def _parsed(path: Path, wanted: str | None) -> tuple[yaml.Node | None, Any]:
    """Return the tree of the text of a file, and the data that it makes.

    Args:
        path: of the file.
        wanted: kind of file, in words.
    """
    import yaml

    # libyaml, where PyYAML has it: a node that takes up a new model answers no one meanwhile.
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(
                f"larger than {_MAX_BYTES >> 20} MiB, not a parameter file"
            )
        text = path.read_text(encoding="utf-8")
        _require_plain(yaml.parse(text, loader))
        return yaml.compose(text, loader), yaml.load(text, loader)
    except InputError:
        raise
    except OSError as error:
        raise InputError(error.strerror or str(error)) from None
    except UnicodeDecodeError as error:
        raise InputError(
            f"not UTF-8 text at byte {error.start}; wanted is {wanted}"
        ) from None
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        # PyYAML lets a ValueError through for an impossible date or an endless number.
        place = _line_of(error, "problem_mark")
        raise InputError(
            f"not YAML{place}: {getattr(error, 'problem', error)}"
        ) from None


_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")


def _other_schema(stated: object, wanted: str) -> str:
    """Return a complaint: the kind of file that was given, and the one that is wanted."""
    complaint = f"schema = {stated!r}; this version reads {wanted!r}"
    kind = kind_of_schema(stated)
    wanted_kind = kind_of_schema(wanted)
    if kind is None or wanted_kind is None or kind == wanted_kind:
        return complaint
    return f"is {kind}; wanted is {wanted_kind} ({complaint})"


def _require_decimal_points(tree: yaml.Node) -> None:
    """Refuse decimal commas: YAML reads `1,9` as text, and within braces as two entries."""
    from yaml.nodes import MappingNode, ScalarNode, SequenceNode

    if isinstance(tree, SequenceNode):
        for item in tree.value:
            _require_decimal_points(item)
    if not isinstance(tree, MappingNode):
        return
    for key, value in tree.value:
        if not isinstance(value, ScalarNode):
            _require_decimal_points(value)
            continue
        is_plain = value.style not in ("'", '"', "|", ">")
        without_value = is_plain and value.value == "" and bool(tree.flow_style)
        if without_value:
            raise InputError(
                f"{key.value}{_line_of(key)} has no value; a decimal comma? write 1.9, "
                "not 1,9"
            )
        if is_plain and _DECIMAL_COMMA.fullmatch(value.value):
            raise InputError(
                f"{key.value} = {value.value}{_line_of(value)} has a decimal comma; write "
                f"{value.value.replace(',', '.')}"
            )


def _require_plain(events: Iterable[yaml.Event]) -> None:
    """Refuse what makes much of a short text, before anything is made of it."""
    from yaml.events import CollectionEndEvent, CollectionStartEvent

    depth = 0
    for count, event in enumerate(events):
        if isinstance(event, CollectionStartEvent):
            depth += 1
        elif isinstance(event, CollectionEndEvent):
            depth -= 1
        complaint = _not_plain(event)
        if depth > _DEEPEST:
            complaint = f"more than {_DEEPEST} levels"
        if count > _MAX_EVENTS:
            complaint = f"more than {_MAX_EVENTS} keys and values"
        if complaint:
            raise InputError(
                f"not YAML of a parameter file{_line_of(event)}: {complaint}"
            )


def _not_plain(event: yaml.Event) -> str:
    """Return what is not plain about a part of a file; empty when nothing."""
    anchor = getattr(event, "anchor", None)
    if anchor:
        return f"{anchor!r} is an alias or the anchor of one: write the values out"
    tag = getattr(event, "tag", None)
    if tag:
        return f"{tag!r} is a tag: write the value alone"
    if getattr(event, "value", None) == "<<":
        return "'<<' merges mappings: write the values out"
    return ""


def _line_of(item: object, mark: str = "start_mark") -> str:
    position = getattr(item, mark, None)
    return f" at line {position.line + 1}" if position else ""


def require_known(
    tree: yaml.Node, known: Mapping[str, Any] | None, where: str = ""
) -> None:
    """Refuse keys that mean nothing, such as a misspelt one, and those that stand there twice."""
    from yaml.nodes import MappingNode, SequenceNode

    if isinstance(tree, SequenceNode):
        for i, item in enumerate(tree.value):
            require_known(item, known, f"{where[:-1]}[{i}].")
    if not isinstance(tree, MappingNode):
        return
    seen = set()
    for key, value in tree.value:
        name = str(key.value)
        if known is not None and name not in known and "*" not in known:
            raise InputError(
                f"{where}{name}{_line_of(key)} is not known; there is "
                f"{', '.join(known)}"
            )
        if name in seen:
            raise InputError(f"{where}{name}{_line_of(key)} stands there twice")
        seen.add(name)
        below = None if known is None else known.get(name, known.get("*"))
        require_known(value, below, f"{where}{name}.")
