# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Small wrong edits of a source file, each at one place of its syntax tree.

Operators, comparisons, numbers, conditions and pairs of names such as min and max are changed.
Left alone are words (docstrings, messages, keys), annotations, decorators, what is raised and
`__all__`: a mutant there says nothing about an answer.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass

_SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
_TURNED = {ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE}
_PAIRS = (
    ("min", "max"),
    ("minimum", "maximum"),
    ("any", "all"),
    ("argmin", "argmax"),
    ("nanmin", "nanmax"),
    ("nanargmin", "nanargmax"),
    ("mean", "median"),
    ("sin", "cos"),
    ("floor", "ceil"),
    ("zeros", "ones"),
)
_NAMES = {old: new for pair in _PAIRS for old, new in (pair, pair[::-1])}
_LEFT_ALONE = {"annotation", "returns", "decorator_list"}


@dataclass(frozen=True)
class Mutation:
    """Replace the bytes from `start` to `end` of a file by `text`.

    `lines` are those of the statement's own code: a test reaches the mutant when it runs one.
    """

    path: str
    start: int
    end: int
    text: str
    lines: tuple[int, int]

    @property
    def key(self) -> str:
        return f"{self.path}:{self.lines[0]}:{self.start}-{self.end}:{self.text}"

    def apply(self, source: bytes) -> bytes:
        return source[: self.start] + self.text.encode() + source[self.end :]


def mutations(path: str, source: bytes) -> Iterator[Mutation]:
    """Every mutation of a file."""
    offsets = [0]
    for line in source.splitlines(keepends=True):
        offsets.append(offsets[-1] + len(line))
    for node, lines in _nodes(ast.parse(source), (1, 1)):
        start = offsets[node.lineno - 1] + node.col_offset
        end = offsets[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)
        for text in _variants(node):
            yield Mutation(path, start, end, text, lines)


def _nodes(
    node: ast.AST, lines: tuple[int, int]
) -> Iterator[tuple[ast.AST, tuple[int, int]]]:
    """Nodes that may be changed, each with the lines of its statement (heads of blocks only)."""
    if isinstance(node, (ast.Raise, ast.JoinedStr, ast.Import, ast.ImportFrom)) or (
        isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    ):
        return
    if isinstance(node, ast.stmt):
        body = getattr(node, "body", None)
        last = max(node.lineno, body[0].lineno - 1) if body else node.end_lineno
        lines = node.lineno, last or node.lineno
    if hasattr(node, "lineno"):
        yield node, lines
    for name, value in ast.iter_fields(node):
        if name not in _LEFT_ALONE:
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from _nodes(child, lines)


def _variants(node: ast.AST) -> Iterator[str]:
    """Texts to put in place of a node."""
    if isinstance(node, (ast.BinOp, ast.BoolOp)) and type(node.op) in _SWAPPED:
        yield _changed(node, op=_SWAPPED[type(node.op)]())
    elif isinstance(node, ast.AugAssign) and type(node.op) in _SWAPPED:
        yield _changed(node, op=_SWAPPED[type(node.op)]())[1:-1]
    elif isinstance(node, ast.Compare):
        for table in (_SWAPPED, _TURNED):
            if type(node.ops[0]) in table:
                yield _changed(node, ops=[table[type(node.ops[0])](), *node.ops[1:]])
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not)):
        yield f"({ast.unparse(node.operand)})"
    elif isinstance(node, ast.Constant):
        yield from _constants(node.value)
    elif isinstance(node, ast.Name) and node.id in _NAMES:
        yield _NAMES[node.id]
    elif isinstance(node, ast.Attribute) and node.attr in _NAMES:
        yield _changed(node, attr=_NAMES[node.attr])
    elif isinstance(node, ast.IfExp):
        yield _changed(node, body=node.orelse, orelse=node.body)
    elif isinstance(node, (ast.Break, ast.Continue)):
        yield "continue" if isinstance(node, ast.Break) else "break"


def _constants(value: object) -> Iterator[str]:
    if isinstance(value, bool):
        yield repr(not value)
    elif isinstance(value, int):
        yield repr(value + 1)
    elif isinstance(value, float):
        yield repr(2.0 * value if value else 1.0)


def _changed(node: ast.AST, **fields: object) -> str:
    """The text of a node with other fields, in brackets."""
    return f"({ast.unparse(type(node)(**{**dict(ast.iter_fields(node)), **fields}))})"
