# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The exported C as JavaScript, so that a page computes with the equations of the C template.

Translates the C that `c_model` writes, and no more: structures, enumerations, functions, constant
tables. Structures become objects, pointers to them references; a pointer to a number becomes an
array of one element. Whatever the translator does not know raises an error.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from hmcvt_core.errors import HmcvtError

_TOKEN = re.compile(
    r'"(?:[^"\\]|\\.)*"|\d+\.?\d*(?:[eE][-+]?\d+)?|\w+'
    r"|->|[-+*/<>=!]=|&&|\|\||\+\+|--|[^\s\w]"
)
_SUFFIX = re.compile(r"\b(\d+\.\d*(?:e[-+]?\d+)?)f\b")
"""Of a literal in single precision; a Float32Array rounds it."""
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_SCALARS = {"hmcvt_real", "float", "double", "int", "bool", "char", "void"}
_FUNCTIONS = {"sqrt": "Math.sqrt", "fabs": "Math.abs", "isnan": "Number.isNaN"}
_LITERALS = {"NAN": "NaN", "INFINITY": "Infinity"}
_BEFORE_OPERAND = set("(,=?:{;}[+-*/<>!") | {
    "return", "&&", "||", "==", "!=", "<=", ">=", "+=", "-=", "*=", "/=",
}  # fmt: skip
"""Tokens after which `&` and `*` take one operand."""

Tokens = Sequence[str]


class Variable(NamedTuple):
    """A variable, parameter or member.

    Attributes:
        name: of it.
        kind: its type without qualifiers.
        is_pointer: whether it is a pointer.
        is_constant: whether what it points to is constant.
        sizes: tokens of each dimension of an array.
    """

    name: str
    kind: str
    is_pointer: bool
    is_constant: bool
    sizes: tuple[str, ...]

    @property
    def is_reference(self) -> bool:
        """Whether it points to one number that a function sets."""
        return self.is_pointer and self.kind in _SCALARS and not self.is_constant


@dataclass
class _Program:
    """What is known of a program while it is translated."""

    structures: dict[str, list[Variable]] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)

    def is_type(self, token: str) -> bool:
        return token in _SCALARS or token in self.structures


def javascript(header: str, source: str) -> str:
    """Return a C header and source as JavaScript declarations.

    Raises:
        HmcvtError: the C holds what the translator does not know.
    """
    defined: dict[str, str] = {}
    text = _preprocessed(header, defined) + _preprocessed(source, defined)
    program = _Program()
    tokens = _TOKEN.findall(_SUFFIX.sub(r"\1", text))
    position = 0
    while position < len(tokens):
        position = _declaration(program, tokens, position)
    return "\n".join(program.lines) + "\n"


def _preprocessed(text: str, defined: dict[str, str]) -> str:
    """Return text without comments and directives; `defined` collects the macros."""
    kept = []
    # Of each nested #if: whether its lines are kept, and whether a branch was taken.
    branches: list[tuple[bool, bool]] = []
    for line in _COMMENT.sub(" ", text).splitlines():
        words = line.split()
        if line.startswith("#"):
            _directive(words, line, branches, defined)
        elif all(active for active, _ in branches):
            kept.append(_expanded(line, defined))
    return "\n".join(kept) + "\n"


def _directive(
    words: Sequence[str],
    line: str,
    branches: list[tuple[bool, bool]],
    defined: dict[str, str],
) -> None:
    kind = words[0]
    if kind in ("#if", "#ifdef", "#ifndef"):
        holds = _holds(kind, words[1:], defined)
        branches.append((holds, holds))
    elif kind == "#elif":
        _, taken = branches.pop()
        holds = not taken and _holds("#if", words[1:], defined)
        branches.append((holds, taken or holds))
    elif kind == "#else":
        _, taken = branches.pop()
        branches.append((not taken, True))
    elif kind == "#endif":
        branches.pop()
    elif kind == "#define" and all(active for active, _ in branches):
        name, *value = words[1:]
        if "(" not in name:
            defined[name] = _expanded(" ".join(value), defined)
    elif kind not in ("#define", "#include", "#pragma"):
        raise HmcvtError(f"C not translated: {line.strip()}")


def _holds(kind: str, words: Sequence[str], defined: Mapping[str, str]) -> bool:
    """Return whether a condition of the preprocessor holds: names joined by &&."""
    if kind == "#ifdef":
        return words[0] in defined
    if kind == "#ifndef":
        return words[0] not in defined
    names = [word for word in words if word != "&&"]
    return all(defined.get(name, "0") == "1" for name in names)


def _expanded(line: str, defined: Mapping[str, str]) -> str:
    """Return a line with macros replaced; R(literal) is the literal."""
    without_r = re.sub(r"\bR\(", "(", line)
    return re.sub(r"\b[A-Z_][A-Z_0-9]*\b", lambda m: defined.get(m[0], m[0]), without_r)


def _closing(tokens: Tokens, start: int) -> int:
    """Return the position of the bracket that closes the one at a position."""
    depth = 0
    for position in range(start, len(tokens)):
        if tokens[position] in "([{":
            depth += 1
        elif tokens[position] in ")]}":
            depth -= 1
            if depth == 0:
                return position
    raise HmcvtError("C not translated: a bracket is not closed")


def _split(tokens: Tokens, mark: str = ",") -> Iterator[list[str]]:
    """Yield the parts between marks that stand in no bracket."""
    part: list[str] = []
    depth = 0
    for token in tokens:
        depth += (token in "([{") - (token in ")]}")
        if token == mark and depth == 0:
            yield part
            part = []
        else:
            part.append(token)
    if part:
        yield part


def _end_of_statement(tokens: Tokens, start: int) -> int:
    position = start
    while tokens[position] != ";":
        if tokens[position] in "([{":
            position = _closing(tokens, position)
        position += 1
    return position


def _declaration(program: _Program, tokens: Tokens, start: int) -> int:
    """Translate one declaration at the top level; return the position after it."""
    if tokens[start] == "typedef":
        return _typedef(program, tokens, start)
    if tokens[start] == "enum":
        end = _closing(tokens, start + 1)
        _enumeration(program, tokens[start + 2 : end])
        return end + 2
    head = start
    while tokens[head] not in ("(", "=", ";"):
        head += 1
    if tokens[head] == "(":
        return _function(program, tokens, start, head)
    end = _end_of_statement(tokens, start)
    if tokens[start] != "extern":
        variable = _variable(program, tokens[start:head])
        value = _initial(program, variable, tokens[head + 1 : end], is_global=True)
        program.lines.append(f"const {variable.name} = {value};")
    return end + 1


def _typedef(program: _Program, tokens: Tokens, start: int) -> int:
    if tokens[start + 1] != "struct":
        return _end_of_statement(tokens, start) + 1
    end = _closing(tokens, start + 2)
    members = [
        _variable(program, part) for part in _split(tokens[start + 3 : end], ";")
    ]
    program.structures[tokens[end + 1]] = members
    return end + 3


def _enumeration(program: _Program, tokens: Tokens) -> None:
    value = -1
    for part in _split(tokens):
        value = int("".join(part[2:])) if len(part) > 1 else value + 1
        program.lines.append(f"const {part[0]} = {value};")


def _variable(program: _Program, tokens: Tokens) -> Variable:
    """Return the variable that tokens declare, such as `const hmcvt_real *x` or `int n[3]`."""
    sizes: list[str] = []
    rest = list(tokens)
    while rest[-1] == "]":
        opening = len(rest) - 1 - rest[::-1].index("[")
        sizes.insert(0, "".join(rest[opening + 1 : -1]))
        rest = rest[:opening]
    name = rest.pop()
    words = [word for word in rest if word not in ("static", "extern", "const", "*")]
    if len(words) != 1 or not program.is_type(words[0]):
        raise HmcvtError(f"C not translated: {' '.join(tokens)}")
    return Variable(name, words[0], "*" in rest, "const" in rest, tuple(sizes))


def _initial(
    program: _Program, variable: Variable, tokens: Tokens, is_global: bool = False
) -> str:
    """Return the initial value of a variable as an expression."""
    if tokens and tokens[0] == "{":
        return _braced(program, variable, tokens, is_global)
    if is_global and tokens[0] == "&":
        # A pointer into a table: the table from there on.
        return f"{tokens[1]}.slice({tokens[3]})" if len(tokens) > 2 else tokens[1]
    return _expression(program, {}, tokens)


def _braced(
    program: _Program, variable: Variable, tokens: Tokens, is_global: bool
) -> str:
    """Return an initialiser in braces as an array or an object."""
    parts = list(_split(tokens[1:-1]))
    if variable.sizes:
        element = variable._replace(sizes=variable.sizes[1:])
        values = [_initial(program, element, part, is_global) for part in parts]
        text = f"[{', '.join(values)}]"
        return f"new Float32Array({text})" if variable.kind == "float" else text
    pairs = []
    for member, value in _members(program, variable, parts):
        pairs.append(f"{member.name}: {_initial(program, member, value, is_global)}")
    return f"{{{', '.join(pairs)}}}"


def _members(
    program: _Program, variable: Variable, parts: Sequence[Tokens]
) -> list[tuple[Variable, Tokens]]:
    """Return each member of a structure with its value, named (`.x = 1`) or in order."""
    members = program.structures[variable.kind]
    if len(parts) != len(members):
        raise HmcvtError(f"C not translated: {variable.name} sets some members only")
    by_name = {member.name: member for member in members}
    values: list[tuple[Variable, Tokens]] = []
    for member, part in zip(members, parts, strict=True):
        if part[0] == ".":
            values.append((by_name[part[1]], part[3:]))
        else:
            values.append((member, part))
    return values


def _function(program: _Program, tokens: Tokens, start: int, head: int) -> int:
    closing = _closing(tokens, head)
    if tokens[closing + 1] == ";":
        return closing + 2
    end = _closing(tokens, closing + 1)
    listed = [part for part in _split(tokens[head + 1 : closing]) if part != ["void"]]
    parameters = [_variable(program, part) for part in listed]
    body = tokens[closing + 2 : end]
    names = {item.name: item for item in parameters}
    names.update(_locals(program, body))
    text = _block(program, names, body)
    signature = ", ".join(item.name for item in parameters)
    program.lines.append(f"function {tokens[head - 1]}({signature}) {{ {text} }}")
    return end + 1


def _starts_declaration(program: _Program, tokens: Tokens, position: int) -> bool:
    before = tokens[position - 1] if position else "{"
    first = position + (tokens[position] == "const")
    return before in ("{", "}", ";") and program.is_type(tokens[first])


def _locals(program: _Program, body: Tokens) -> dict[str, Variable]:
    """Return the variables of a body; numbers whose address is taken become references."""
    found = {}
    for position in range(len(body)):
        if _starts_declaration(program, body, position):
            end = position
            while body[end] not in ("=", ";"):
                end += 1
            variable = _variable(program, body[position:end])
            found[variable.name] = variable
    for position, token in enumerate(body[:-2]):
        name = body[position + 1]
        is_address = token == "&" and body[position - 1] in _BEFORE_OPERAND
        if is_address and name in found and body[position + 2] in (",", ")"):
            variable = found[name]
            if variable.kind in _SCALARS and not variable.sizes:
                found[name] = variable._replace(is_pointer=True, is_constant=False)
    return found


def _block(program: _Program, names: Mapping[str, Variable], body: Tokens) -> str:
    """Return the statements of a body."""
    parts = []
    position = 0
    while position < len(body):
        token = body[position]
        if token in ("{", "}", "else"):
            parts.append(token)
            position += 1
        elif token in ("if", "for", "while"):
            end = _closing(body, position + 1)
            inner = "; ".join(
                _assignment(program, names, part)
                for part in _split(body[position + 2 : end], ";")
            )
            parts.append(f"{token} ({inner})")
            position = end + 1
        else:
            end = _end_of_statement(body, position)
            statement = body[position:end]
            if _starts_declaration(program, body, position):
                parts.append(_local(program, names, statement))
            elif statement[:3] != ["(", "void", ")"]:
                parts.append(_assignment(program, names, statement) + ";")
            position = end + 1
    return " ".join(parts)


def _local(program: _Program, names: Mapping[str, Variable], statement: Tokens) -> str:
    """Return the declaration of a local variable."""
    equals = statement.index("=") if "=" in statement else len(statement)
    variable = _variable(program, statement[:equals])
    value = list(statement[equals + 1 :])
    if value and value[0] == "{":
        text = _braced_local(program, names, variable, value)
    elif value:
        text = _expression(program, names, value)
    else:
        text = _unset(program, variable)
    if names[variable.name].is_reference:
        text = f"[{text}]"
    return f"let {variable.name} = {text};"


def _braced_local(
    program: _Program,
    names: Mapping[str, Variable],
    variable: Variable,
    tokens: Tokens,
) -> str:
    parts = list(_split(tokens[1:-1]))
    if variable.sizes:
        values = [_expression(program, names, part) for part in parts]
        return f"[{', '.join(values)}]"
    pairs = []
    for member, value in _members(program, variable, parts):
        pairs.append(f"{member.name}: {_expression(program, names, value)}")
    return f"{{{', '.join(pairs)}}}"


def _unset(program: _Program, variable: Variable) -> str:
    """Return the value of a variable that is set later."""
    if variable.sizes:
        element = variable._replace(sizes=variable.sizes[1:])
        return f"Array.from({{length: {variable.sizes[0]}}}, () => ({_unset(program, element)}))"
    return "{}" if variable.kind in program.structures else "NaN"


def _assignment(
    program: _Program, names: Mapping[str, Variable], statement: Tokens
) -> str:
    """Return a statement; structures are copied where C copies them."""
    if "=" not in statement:
        return _expression(program, names, statement)
    equals = list(statement).index("=")
    left, right = statement[:equals], statement[equals + 1 :]
    value = _expression(program, names, right)
    target = names.get(left[0])
    if _is_structure(program, names, right):
        value = f"{{...{value}}}"
    if target is not None and target.kind == "int" and "/" in right:
        value = f"Math.trunc({value})"
    if left[0] == "*" and names[left[1]].kind in program.structures:
        return f"Object.assign({left[1]}, {value})"
    return f"{_expression(program, names, left)} = {value}"


def _is_structure(
    program: _Program, names: Mapping[str, Variable], tokens: Tokens
) -> bool:
    """Return whether an expression is a structure of a variable, not a pointer to one."""
    variable = names.get(tokens[-1])
    if variable is None or variable.kind not in program.structures:
        return False
    if variable.is_pointer:
        return list(tokens[:-1]) == ["*"]
    return len(tokens) == 1


def _expression(
    program: _Program, names: Mapping[str, Variable], tokens: Tokens
) -> str:
    """Return an expression in JavaScript."""
    parts: list[str] = []
    position = 0
    while position < len(tokens):
        token = tokens[position]
        before = tokens[position - 1] if position else "="
        takes_one = before in _BEFORE_OPERAND
        if token == "(" and tokens[position + 1] in _SCALARS:
            position += 3  # a cast between numbers
            continue
        if token in "&*" and takes_one:
            text, used = _address(names, tokens, position)
            parts.append(text)
            position += used
            continue
        parts.append(_word(names, token, before))
        position += 1
    return " ".join(parts)


def _address(
    names: Mapping[str, Variable], tokens: Tokens, position: int
) -> tuple[str, int]:
    """Return what `&` or `*` and its operand become, and how many tokens they take."""
    name = tokens[position + 1]
    variable = names.get(name)
    is_number = variable is not None and variable.kind in _SCALARS
    if tokens[position] == "*":
        return (f"{name}[0]", 2) if is_number else (name, 2)
    if is_number and variable is not None and variable.sizes:
        end = _closing(tokens, position + 2)
        index = "".join(tokens[position + 3 : end])
        return f"element({name}, {index})", end + 1 - position
    if is_number:
        return name, 2
    return "", 1  # the address of a structure is the object


def _word(names: Mapping[str, Variable], token: str, before: str) -> str:
    if token == "->":
        return "."
    if before in (".", "->"):
        return token
    if token in names and names[token].is_reference:
        # As an argument the reference is passed on; else its number is meant.
        own = names[token]
        return token if own.sizes else f"{token}[0]"
    return _FUNCTIONS.get(token, _LITERALS.get(token, token))
